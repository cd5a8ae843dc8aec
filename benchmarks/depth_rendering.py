"""Depth rendering beside MuJoCo's rays.

Run with `python -m benchmarks.depth_rendering`. Each scene is seen from its middle in four directions: what is in
view changes the cost.
"""

from collections.abc import Iterator

from iwalker_jax.runtime import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Group, Work
from iwalker_jax.perception import CameraMount, Intrinsics
from iwalker_jax.scenes import (
    SceneArrays,
    generate_scene,
    load_mujoco_scene,
    mujoco_ray_depth,
    render_depth,
    stack_scenes,
    world_camera_pose,
)

SIZES = ((160, 80), (160, 90), (320, 160), (640, 320))
QUICK_SIZES = ((160, 90),)
SCENES = (("living_room", 1), ("factory_hall", 0), ("open_office", 1), ("lobby", 0))
BATCH = 16
_APART = 1e-4  # [m]

View = tuple[int, jax.Array, jax.Array]
"""Number of the scene, R_world_camera and p_world_camera."""


def views_of(scenes: list) -> list[View]:
    """Four directions from the middle of every scene."""
    mount, rng = CameraMount().as_array(), np.random.default_rng(0)
    views = []
    for i, scene in enumerate(scenes):
        x, y = (scene.bounds[0] + scene.bounds[2]) / 2, (scene.bounds[1] + scene.bounds[3]) / 2
        for yaw in np.arange(4) * np.pi / 2 + rng.uniform(0, 1):
            views.append((i, *world_camera_pose(jnp.asarray([x, y, yaw], jnp.float32), mount)))
    return views


def compare(
    intrinsics: Intrinsics,
    arrays: list[SceneArrays],
    peers: list[tuple[mujoco.MjModel, mujoco.MjData]],
    stacked: SceneArrays,
    views: list[View],
    repeats: int,
) -> Group:
    """One image size.

    Args:
        intrinsics: of the images.
        arrays, peers: the scenes here and in MuJoCo.
        stacked: a batch of scenes.
        views: that are rendered one after the other.
        repeats: turns.
    """
    single = jax.jit(lambda s, R, p: render_depth(s, intrinsics, R, p))
    over_poses = jax.jit(jax.vmap(lambda s, R, p: render_depth(s, intrinsics, R, p), in_axes=(None, 0, 0)))
    over_scenes = jax.jit(jax.vmap(lambda s, R, p: render_depth(s, intrinsics, R, p)))
    on_host = [(i, np.asarray(R), np.asarray(p)) for i, R, p in views]

    def rays() -> list[np.ndarray]:
        return [mujoco_ray_depth(*peers[i], intrinsics, R, p) for i, R, p in on_host]

    exact = np.stack(rays())

    def apart(images: list[np.ndarray]) -> dict[str, float]:
        return {f"pixels apart > {_APART:g} m": float(np.mean(np.abs(np.stack(images) - exact) > _APART))}

    own = [views[k % 4] for k in range(BATCH)]
    mixed = [views[4 * (k % len(arrays)) + (k // len(arrays)) % 4] for k in range(BATCH)]
    one_scene = arrays[0], jnp.stack([v[1] for v in own]), jnp.stack([v[2] for v in own])
    many_scenes = stacked, jnp.stack([v[1] for v in mixed]), jnp.stack([v[2] for v in mixed])
    work = Work(bytes=4.0 * intrinsics.width * intrinsics.height)

    def one_by_one() -> list[jax.Array]:
        return [single(arrays[i], R, p) for i, R, p in views]

    rows = [
        Contender("ours, one by one", "ours", one_by_one, len(views), apart, work),
        Contender(f"ours, {BATCH} poses", "ours", lambda: over_poses(*one_scene), BATCH, None, work),
        Contender(f"ours, {BATCH} poses and scenes", "ours", lambda: over_scenes(*many_scenes), BATCH, None, work),
        Contender("mj_multiRay", "peer", rays, len(views), apart, compiles=False),
    ]
    return contest(f"{intrinsics.width} x {intrinsics.height} px", "an image", rows, repeats)


def measure(options: Options) -> Iterator[Group]:
    """All figures of this benchmark."""
    scenes = [generate_scene(*key) for key in SCENES]
    arrays = [scene.arrays() for scene in scenes]
    peers = [load_mujoco_scene(scene) for scene in scenes]
    stacked = stack_scenes([scenes[i % len(scenes)] for i in range(BATCH)])
    views = views_of(scenes)
    for width, height in QUICK_SIZES if options.quick else SIZES:
        intrinsics = Intrinsics(width, height, width / 2, width / 2, (width - 1) / 2, (height - 1) / 2)
        yield compare(intrinsics, arrays, peers, stacked, views, 3 if options.quick else 9)


if __name__ == "__main__":
    options = tyro.cli(Options, description=__doc__)
    present(measure(options), options)
