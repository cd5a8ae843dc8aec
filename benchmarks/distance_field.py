"""Signed distance field: error and speed against SciPy's and OpenCV's exact transforms on easy and hard maps.

Run with `python -m benchmarks.distance_field`. Both peers do the same two-sided work: one transform a side.
"""

from functools import partial

from benchmarks.extras import read_no_options, require
from iwalker_jax.runtime.settings import configure_runtime

configure_runtime()
require("scipy")

import cv2  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy  # noqa: E402
from scipy.ndimage import distance_transform_edt  # noqa: E402

from benchmarks.timing import compiled, in_turns  # noqa: E402
from iwalker_jax.perception import signed_distance_field  # noqa: E402
from iwalker_jax.runtime.devices import machine  # noqa: E402

SIZES = (100, 160, 200, 400, 512)
BATCH = 16
RESOLUTION = 0.05
DENSITIES = (0.001, 0.01, 0.1, 0.5)


def rooms(size: int, rng: np.random.Generator, tilted: bool) -> np.ndarray:
    """A walled building: a frame and six free-standing walls, two cells thick, upright or at any angle."""
    image = np.zeros((size, size), np.uint8)
    frame = np.array([[0, 0], [0, size - 1], [size - 1, size - 1], [size - 1, 0]])
    turn = rng.uniform(0, np.pi / 2) if tilted else 0.0
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    walls = list(zip(frame, np.roll(frame, 1, axis=0)))
    for n in range(6):
        start = rng.integers(0, size, 2)
        walls.append((start, start + rng.integers(size // 6, size // 2) * np.eye(2)[n % 2]))
    for wall in walls:
        first, last = ((np.asarray(end) - size / 2) @ rotation.T + size / 2 for end in wall)
        cv2.line(image, first.round().astype(int).tolist(), last.round().astype(int).tolist(), 1, 2)
    return image > 0


def single_cell(size: int, cell: int) -> np.ndarray:
    """One obstacle on the main diagonal."""
    occupied = np.zeros((size, size), bool)
    occupied[cell, cell] = True
    return occupied


def benchmark_maps(size: int) -> dict[str, np.ndarray]:
    """Batches of maps by name; a diagonal wall is the hardest for the row pass."""
    rng = np.random.default_rng(0)
    maps = {f"random {density:.1%}": rng.random((BATCH, size, size)) < density for density in DENSITIES}
    maps["one in corner"] = np.stack([single_cell(size, 0)] * BATCH)
    maps["one in middle"] = np.stack([single_cell(size, size // 2)] * BATCH)
    maps["rooms"] = np.stack([rooms(size, rng, tilted=False) for _ in range(BATCH)])
    maps["tilted rooms"] = np.stack([rooms(size, rng, tilted=True) for _ in range(BATCH)])
    maps["diagonal wall"] = np.stack([np.eye(size, dtype=bool)] * BATCH)
    return maps


def by_scipy(occupied: np.ndarray) -> np.ndarray:
    """The same field by SciPy."""
    signed = np.where(occupied, 0.5 - distance_transform_edt(occupied), distance_transform_edt(~occupied) - 0.5)
    return RESOLUTION * signed


def by_opencv(occupied: np.ndarray) -> np.ndarray:
    """The same field by OpenCV."""
    free = 1 - occupied.astype(np.uint8)
    outside, inside = (cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in (free, 1 - free))
    return RESOLUTION * np.where(occupied, 0.5 - inside, outside - 0.5)


def by_opencv_all(maps: np.ndarray) -> list[np.ndarray]:
    """The fields of a batch by OpenCV, one after another: it has no batched call."""
    return [by_opencv(occupied) for occupied in maps]


def main() -> None:
    """Print the table."""
    print(f"{machine()}, SciPy {scipy.__version__}, OpenCV {cv2.__version__} on {cv2.getNumThreads()} threads")
    print(f"milliseconds a map, best (median); batch of {BATCH}; ratios of the best: below 1 the library is faster")
    print(
        f"{'size':>4} {'map':<14} {'error m':>8} {'single':>13} {'batch':>13} {'SciPy':>13} {'one side':>8} "
        f"{'OpenCV':>13} {'single/SciPy':>12} {'batch/OpenCV':>12}"
    )
    single = jax.jit(lambda occupied: signed_distance_field(occupied, RESOLUTION))
    batched = jax.jit(jax.vmap(lambda occupied: signed_distance_field(occupied, RESOLUTION)))
    for size in SIZES:
        taken = compiled(single, jax.ShapeDtypeStruct((size, size), bool))[1]
        for name, maps in benchmark_maps(size).items():
            first, device = jnp.asarray(maps[0]), jnp.asarray(maps)
            error = max(np.abs(np.asarray(field) - by_scipy(m)).max() for field, m in zip(batched(device), maps))
            error = max(error, np.abs(np.asarray(single(first)) - by_scipy(maps[0])).max())
            one = in_turns(
                {
                    "single": partial(single, first),
                    "scipy": partial(by_scipy, maps[0]),
                    "one side": partial(distance_transform_edt, ~maps[0]),
                },
                repeats=9,
            )
            many = in_turns({"batch": partial(batched, device), "opencv": partial(by_opencv_all, maps)}, repeats=5)
            batch, opencv = (times.each(BATCH) for times in many.values())
            print(
                f"{size:>4} {name:<14} {error:8.1e} {one['single'].milliseconds():>13} {batch.milliseconds():>13} "
                f"{one['scipy'].milliseconds():>13} {1e3 * one['one side'].best:8.2f} {opencv.milliseconds():>13} "
                f"{one['single'].best / one['scipy'].best:12.2f} {batch.best / opencv.best:12.2f}"
            )
        print(f"{size:>4} single map compiled, or loaded from the compilation cache, in {taken:.2f} s")


if __name__ == "__main__":
    read_no_options(__doc__)
    main()
