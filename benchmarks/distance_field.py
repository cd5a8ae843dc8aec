"""Signed distance field beside the exact transforms of SciPy, OpenCV and edt and scikit-fmm's marching, on hard maps.

Run with `python -m benchmarks.distance_field`. All do the same two-sided work; SciPy's field is what errors are from.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec

from benchmarks.suite.extras import absent, require
from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()
require("scipy")

import cv2  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import tyro  # noqa: E402

from benchmarks.peers.distance_fields import PACKAGES, PEERS, RESOLUTION, by_scipy  # noqa: E402
from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Group, Work  # noqa: E402
from iwalker_jax.perception import signed_distance_field  # noqa: E402

BATCH = 16
DENSITIES = (0.001, 0.01, 0.1, 0.5)
QUICK_MAPS = ("random 1.0%", "tilted rooms")


@dataclass(frozen=True)
class Config(Options):
    """Time one map and batches of maps, and measure their errors.

    Attributes:
        sizes: rows and columns of the maps; 160 alone with --quick.
    """

    sizes: tuple[int, ...] = (100, 160, 200, 400, 512)


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


def all_of(field: Callable[[np.ndarray], np.ndarray], maps: np.ndarray) -> np.ndarray:
    """The fields of a batch, one after another: the peers have no batched call."""
    return np.stack([field(occupied) for occupied in maps])


def worst_error(exact: np.ndarray, found: np.ndarray) -> dict[str, float]:
    """Largest difference from the exact fields."""
    return {"worst error [m]": float(np.max(np.abs(np.asarray(found) - exact)))}


def measure(config: Config) -> Iterator[Group]:
    """All figures of this benchmark."""
    single = jax.jit(lambda occupied: signed_distance_field(occupied, RESOLUTION))
    batched = jax.jit(jax.vmap(lambda occupied: signed_distance_field(occupied, RESOLUTION)))
    peers = {name: peer.field for name, peer in PEERS.items() if find_spec(peer.module)}
    for size in (160,) if config.quick else config.sizes:
        work = Work(bytes=5.0 * size * size)
        for name, maps in benchmark_maps(size).items():
            if config.quick and name not in QUICK_MAPS:
                continue
            exact = all_of(by_scipy, maps)
            one, many = partial(worst_error, exact[0]), partial(worst_error, exact)
            first, device = jnp.asarray(maps[0]), jnp.asarray(maps)
            title = f"{size} x {size}, {name}"
            theirs = [
                Contender(peer, "peer", partial(field, maps[0]), 1, one, compiles=False)
                for peer, field in peers.items()
            ]
            ours = Contender("ours", "ours", partial(single, first), 1, one, work)
            yield contest(f"{title}, one map", "a map", [ours, *theirs], 15)
            theirs = [
                Contender(f"{peer}, one by one", "peer", partial(all_of, field, maps), BATCH, many, compiles=False)
                for peer, field in peers.items()
            ]
            ours = Contender(f"ours, {BATCH} side by side", "ours", partial(batched, device), BATCH, many, work)
            yield contest(f"{title}, {BATCH} maps", "a map", [ours, *theirs], 5)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options, absent(PACKAGES))
