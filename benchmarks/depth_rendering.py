"""Depth rendering: images a second against MuJoCo's rays, with the two images' disagreement beside the speed.

Run with `python -m benchmarks.depth_rendering`.
"""

from iwalker_jax.runtime import configure_runtime

configure_runtime()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import mujoco  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.extras import read_no_options  # noqa: E402
from benchmarks.timing import timed  # noqa: E402
from iwalker_jax.perception import CameraMount, Intrinsics  # noqa: E402
from iwalker_jax.runtime import machine  # noqa: E402
from iwalker_jax.scenes import (  # noqa: E402
    SceneArrays,
    generate_scene,
    load_mujoco_scene,
    mujoco_ray_depth,
    render_depth,
    stack_scenes,
    world_camera_pose,
)

SIZES = ((160, 80), (160, 90), (320, 160), (640, 320))
SCENES = (("living_room", 1), ("factory_hall", 0), ("open_office", 1), ("lobby", 0))
BATCH = 16
REPEATS = 15


def main() -> None:
    """Print the table."""
    scenes = [generate_scene(*key) for key in SCENES]
    arrays = [scene.arrays() for scene in scenes]
    peers = [load_mujoco_scene(scene) for scene in scenes]
    stacked = stack_scenes([scenes[i % len(scenes)] for i in range(BATCH)])
    mount = CameraMount().as_array()
    rng = np.random.default_rng(0)
    # Each scene is seen from its middle in four directions: what lies in view changes the cost.
    views = []
    for i, scene in enumerate(scenes):
        x, y = (scene.bounds[0] + scene.bounds[2]) / 2, (scene.bounds[1] + scene.bounds[3]) / 2
        for yaw in np.arange(4) * np.pi / 2 + rng.uniform(0, 1):
            views.append((i, *world_camera_pose(jnp.asarray([x, y, yaw], jnp.float32), mount)))
    counts = [len(scene.boxes) + len(scene.cylinders) for scene in scenes]
    print(
        f"{machine()}, mujoco {mujoco.__version__}; scenes of {counts} geoms; "
        f"images a second, best and median over {REPEATS} runs"
    )
    print(
        f"{'size':>9} {'compile s':>9} {'single best':>11} {'median':>7} {'slowest view':>12} {'batch poses':>11} "
        f"{'batch scenes':>12} {'mj_multiRay':>11} {'ratio':>6} {'pixels apart > 1e-4 m':>22}"
    )
    for width, height in SIZES:
        report(
            Intrinsics(width, height, width / 2, width / 2, (width - 1) / 2, (height - 1) / 2),
            arrays,
            peers,
            stacked,
            views,
        )


def report(
    intrinsics: Intrinsics,
    arrays: list[SceneArrays],
    peers: list[tuple[mujoco.MjModel, mujoco.MjData]],
    stacked: SceneArrays,
    views: list[tuple[int, jax.Array, jax.Array]],
) -> None:
    """Measure one image size and print its row.

    Args:
        intrinsics: of the images.
        arrays, peers: the scenes here and in MuJoCo.
        stacked: a batch of scenes.
        views: (number of the scene, R_world_camera, p_world_camera).
    """
    single = jax.jit(lambda s, R, p: render_depth(s, intrinsics, R, p))
    over_poses = jax.jit(jax.vmap(lambda s, R, p: render_depth(s, intrinsics, R, p), in_axes=(None, 0, 0)))
    over_scenes = jax.jit(jax.vmap(lambda s, R, p: render_depth(s, intrinsics, R, p)))

    ours, theirs, apart = [], [], []
    for i, R, p in views:
        ours.append(timed(single, arrays[i], R, p, repeats=REPEATS))
        model, data = peers[i]
        R_host, p_host = np.asarray(R), np.asarray(p)
        theirs.append(timed(mujoco_ray_depth, model, data, intrinsics, R_host, p_host, repeats=3))
        peer = mujoco_ray_depth(model, data, intrinsics, R_host, p_host)
        apart.append((abs(np.asarray(single(arrays[i], R, p)) - peer) > 1e-4).mean())
    own = [views[k % 4] for k in range(BATCH)]
    mixed = [views[4 * (k % len(arrays)) + (k // len(arrays)) % 4] for k in range(BATCH)]
    one_scene = arrays[0], jnp.stack([v[1] for v in own]), jnp.stack([v[2] for v in own])
    many_scenes = stacked, jnp.stack([v[1] for v in mixed]), jnp.stack([v[2] for v in mixed])
    pose_rate = BATCH / timed(over_poses, *one_scene, repeats=REPEATS).best
    scene_rate = BATCH / timed(over_scenes, *many_scenes, repeats=REPEATS).best
    best = 1 / np.mean([t.best for t in ours])
    median = 1 / np.mean([t.median for t in ours])
    slowest = 1 / max(t.best for t in ours)
    rays = 1 / np.mean([t.best for t in theirs])
    print(
        f"{intrinsics.width:>5}x{intrinsics.height:<3} {ours[0].first:>9.2f} {best:>11.0f} {median:>7.0f} "
        f"{slowest:>12.0f} {pose_rate:>11.0f} {scene_rate:>12.0f} {rays:>11.0f} {best / rays:>6.1f} "
        f"{np.mean(apart):>22.5%}"
    )


if __name__ == "__main__":
    read_no_options(__doc__)
    main()
