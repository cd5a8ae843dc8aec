"""Depth to maps: speed of each stage at 160 x 90 px, and what the sensor's noise costs in quality.

Run with `python -m benchmarks.local_map`. Quality compares the map of noisy frames with the map of the same frames
without noise: recall is the share of occupied cells found again within one cell, phantoms are occupied cells more than
0.1 m from any obstacle of the scene.
"""

from collections.abc import Callable

from iwalker_jax.runtime.settings import configure_runtime

configure_runtime()

import cv2  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

from benchmarks.extras import read_no_options  # noqa: E402
from benchmarks.timing import timed  # noqa: E402
from iwalker_jax.perception import (  # noqa: E402
    DEFAULT_GRID,
    CameraMount,
    Intrinsics,
    SoftOccupancy,
    backproject,
    build_local_map,
    clean_depth,
    fit_floor,
    frame_cells,
    signed_distance_field,
)
from iwalker_jax.perception.collision_map import (  # noqa: E402
    DEFAULT_OBSTACLES,
    occupancy_map,
    published_collision_map,
)
from iwalker_jax.runtime.devices import machine  # noqa: E402
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene  # noqa: E402
from iwalker_jax.scenes.depth_noise import DepthNoise, add_depth_noise  # noqa: E402
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose  # noqa: E402
from iwalker_jax.scenes.scene import SceneArrays, obstacle_distance  # noqa: E402

INTRINSICS = Intrinsics()
BATCH = 16
REPEATS = 40
VIEWS = 45
RANGES = ((0.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 7.0))


def numpy_published(depth: np.ndarray, points: np.ndarray, height: float) -> np.ndarray:
    """The published map as a NumPy and OpenCV program would make it from ready-made points: the peer."""
    kept = points[(depth > 0.8) & (np.abs(points[..., 2] - height) < 0.2)]
    counts, _, _ = np.histogram2d(kept[:, 0], kept[:, 1], bins=100, range=((0.0, 10.0), (-5.0, 5.0)))
    values = np.where(counts >= 2, np.minimum(0.1 * counts, 2.0), 0.0)
    return cv2.GaussianBlur(values, (7, 7), 1.4)


def views(count: int) -> list[tuple[SceneArrays, jax.Array, jax.Array]]:
    """(scene, base pose, mount) with 0.35 m of free space around the robot."""
    rng = np.random.default_rng(0)
    found = []
    for index in range(count):
        scene = generate_scene(FAMILIES[index % len(FAMILIES)], index // len(FAMILIES)).arrays()
        low, high = np.asarray(scene.bounds[:2]), np.asarray(scene.bounds[2:])
        poses = np.concatenate([rng.uniform(low, high, (100, 2)), rng.uniform(-np.pi, np.pi, (100, 1))], axis=1)
        free = np.asarray(obstacle_distance(scene, jnp.asarray(poses[:, :2]))) > 0.35
        mount = CameraMount(
            height=0.58 + 0.02 * rng.normal(), pitch=0.26 + 0.05 * rng.normal(), roll=0.05 * rng.normal()
        )
        found.append((scene, jnp.asarray(poses[np.argmax(free)]), mount.as_array()))
    return found


def speed_table(depth: jax.Array, mount: jax.Array) -> None:
    """Stages in milliseconds a frame, alone and in a batch."""
    key, occupied = jax.random.key(0), occupancy_map(depth, mount, INTRINSICS)
    stages: dict[str, tuple[Callable, tuple[jax.Array, ...]]] = {
        "clean_depth": (clean_depth, (depth,)),
        "frame_cells": (
            lambda d, m: frame_cells(d, m, INTRINSICS, DEFAULT_GRID, DEFAULT_OBSTACLES),
            (depth, mount),
        ),
        "published_collision_map": (lambda d, m: published_collision_map(d, m, INTRINSICS), (depth, mount)),
        "signed_distance_field 160 x 160": (lambda o: signed_distance_field(o, DEFAULT_GRID.resolution), (occupied,)),
        "build_local_map (all of the above)": (lambda d, m: build_local_map(d, m, INTRINSICS), (depth, mount)),
        "build_local_map, soft": (lambda d, m: build_local_map(d, m, INTRINSICS, soft=SoftOccupancy()), (depth, mount)),
        "fit_floor": (lambda d: fit_floor(d, INTRINSICS), (depth,)),
        "add_depth_noise": (lambda k, d: add_depth_noise(k, d, DepthNoise(), INTRINSICS), (key, depth)),
    }
    print(f"{'stage':36s} {'first call':>10s} {'min':>8s} {'median':>8s}   batch of {BATCH}, a frame")
    for name, (function, arguments) in stages.items():
        one = timed(jax.jit(function), *arguments, repeats=REPEATS)
        many = [jnp.stack([argument] * BATCH) for argument in arguments]
        each = timed(jax.jit(jax.vmap(function)), *many, repeats=REPEATS).each(BATCH)
        print(
            f"{name:36s} {one.first:8.2f} s {1e3 * one.best:8.3f} {1e3 * one.median:8.3f}   "
            f"min {1e3 * each.best:.3f}, median {1e3 * each.median:.3f} ms"
        )
    points = np.asarray(backproject(depth, INTRINSICS, mount))
    peer = timed(lambda: numpy_published(np.asarray(depth), points, float(mount[0])), repeats=REPEATS)
    print(
        f"{'peer: published map, NumPy + OpenCV':36s} {'':10s} {1e3 * peer.best:8.3f} {1e3 * peer.median:8.3f}   "
        f"(points ready-made)"
    )


def quality_table(frames: list[tuple[SceneArrays, jax.Array, jax.Array]]) -> None:
    """Recall, phantoms and free cells of noisy frames by distance."""
    centres = DEFAULT_GRID.centres()

    @jax.jit
    def maps(scene: SceneArrays, pose: jax.Array, mount: jax.Array, key: jax.Array) -> tuple[jax.Array, ...]:
        ideal = render_depth(scene, INTRINSICS, *world_camera_pose(pose, mount))
        noisy = add_depth_noise(key, ideal, DepthNoise(), INTRINSICS)
        cos, sin = jnp.cos(pose[2]), jnp.sin(pose[2])
        world = centres @ jnp.stack([jnp.stack([cos, sin]), jnp.stack([-sin, cos])]) + pose[:2]
        reference, found = (build_local_map(d, mount, INTRINSICS) for d in (ideal, noisy))
        return reference.occupied, found.occupied, found.known_free, obstacle_distance(scene, world)

    results = [maps(*frame, jax.random.key(index)) for index, frame in enumerate(frames)]
    reference, found, free, distance = (np.stack(column) for column in zip(*results))
    near = np.stack([cv2.dilate(m.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0 for m in found])
    reach = np.linalg.norm(np.asarray(centres), axis=-1)
    print(f"\nnoisy frames ({len(frames)} views)   recall   phantom cells a frame   solid among free")
    for low, high in RANGES:
        ring = (reach >= low) & (reach < high)
        recall = (reference & near & ring).sum() / max((reference & ring).sum(), 1)
        phantoms = (found & ring & (distance > 0.1)).sum() / len(frames)
        solid = (free & ring & (distance < -0.05)).sum() / max((free & ring).sum(), 1)
        print(f"  {low:g}-{high:g} m {'':17s} {recall:8.3f} {phantoms:12.2f} {100 * solid:21.2f} %")


def main() -> None:
    """Print the tables."""
    print(f"{machine()}\n")
    frames = views(VIEWS)
    scene, pose, mount = frames[0]
    depth = jax.jit(lambda s, p, m: render_depth(s, INTRINSICS, *world_camera_pose(p, m)))(scene, pose, mount)
    speed_table(depth, mount)
    quality_table(frames)


if __name__ == "__main__":
    read_no_options(__doc__)
    main()
