"""Depth to maps: speed of each stage at 160 x 90 px, beside NumPy and OpenCV, and what the sensor's noise costs.

Run with `python -m benchmarks.local_map`. Quality compares the map of noisy frames with the map of the same frames
without noise: recall is the share of occupied cells found again within one cell, phantoms are occupied cells more than
0.1 m from any obstacle of the scene.
"""

from collections.abc import Callable, Iterator
from functools import partial

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group
from iwalker_jax.perception import (
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
from iwalker_jax.perception.collision_map import (
    DEFAULT_OBSTACLES,
    occupancy_map,
    published_collision_map,
)
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene
from iwalker_jax.scenes.depth_noise import DepthNoise, add_depth_noise
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import SceneArrays, obstacle_distance

INTRINSICS = Intrinsics()
BATCH = 16
VIEWS = 45
_QUICK_STAGES = 5
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


def stage_times(depth: jax.Array, mount: jax.Array, quick: bool) -> Iterator[Group]:
    """Stages, alone and in a batch."""
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
    for name, (function, arguments) in list(stages.items())[: _QUICK_STAGES if quick else None]:
        many = [jnp.stack([argument] * BATCH) for argument in arguments]
        rows = [
            Contender("ours, one frame", "ours", partial(jax.jit(function), *arguments)),
            Contender(f"ours, {BATCH} frames", "ours", partial(jax.jit(jax.vmap(function)), *many), BATCH),
        ]
        if name == "published_collision_map":
            ready = np.asarray(depth), np.asarray(backproject(depth, INTRINSICS, mount)), float(mount[0])
            peer = partial(numpy_published, *ready)
            rows.append(Contender("NumPy and OpenCV, points ready-made", "peer", peer, compiles=False))
        yield contest(name, "a frame", rows, 10 if quick else 40)


def noise_costs(frames: list[tuple[SceneArrays, jax.Array, jax.Array]]) -> Iterator[Fact]:
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
    for low, high in RANGES:
        ring = (reach >= low) & (reach < high)
        recall = (reference & near & ring).sum() / max((reference & ring).sum(), 1)
        phantoms = (found & ring & (distance > 0.1)).sum() / len(frames)
        solid = (free & ring & (distance < -0.05)).sum() / max((free & ring).sum(), 1)
        ends = f"{low:g} to {high:g} m"
        yield Fact(f"noisy frames, {ends}: recall", recall)
        yield Fact(f"noisy frames, {ends}: phantom cells", phantoms, "a frame")
        yield Fact(f"noisy frames, {ends}: solid among free", 100 * solid, "%")


def measure(options: Options) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    frames = views(1 if options.quick else VIEWS)
    scene, pose, mount = frames[0]
    depth = jax.jit(lambda s, p, m: render_depth(s, INTRINSICS, *world_camera_pose(p, m)))(scene, pose, mount)
    yield from stage_times(depth, mount, options.quick)
    if not options.quick:
        yield from noise_costs(frames)


if __name__ == "__main__":
    options = tyro.cli(Options, description=__doc__)
    present(measure(options), options)
