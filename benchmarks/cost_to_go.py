"""Cost-to-go beside SciPy's Dijkstra on the same graph.

Run with `python -m benchmarks.cost_to_go`. Dijkstra gets its graph ready-made; building it is not timed.
"""

from collections.abc import Iterator
from functools import partial

from benchmarks.suite.extras import require
from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()
require("scipy")

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import tyro  # noqa: E402
from scipy.ndimage import distance_transform_edt  # noqa: E402
from scipy.sparse import csr_matrix  # noqa: E402
from scipy.sparse.csgraph import dijkstra  # noqa: E402

from benchmarks.suite.alone import Options, present  # noqa: E402
from benchmarks.suite.contest import Contender, contest  # noqa: E402
from benchmarks.suite.figures import Group, Work  # noqa: E402
from iwalker_jax.optimization import Solution  # noqa: E402
from iwalker_jax.perception import (  # noqa: E402
    UNREACHABLE,
    GridSpec,
    cost_to_go,
)

SIZES = (80, 160)
BATCH = 64


def benchmark_maps(size: int, resolution: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Batches of costs by name; a dozen rectangles block the way in each. Noise bends routes at every cell."""
    blocked = np.zeros((BATCH, size, size), bool)
    for occupied in blocked:
        for _ in range(12):
            i, j = rng.integers(0, size, 2)
            height, width = rng.integers(3, size // 4, 2)
            occupied[i : i + height, j : j + width] = True
    clearance = np.stack([distance_transform_edt(~occupied) * resolution for occupied in blocked])
    costs = {
        "uniform": np.ones(blocked.shape),
        "dear near walls": 1 + 4 * np.exp(-clearance / 0.3),
        "noise 1 to 3": rng.uniform(1, 3, blocked.shape),
    }
    return {name: np.where(blocked, np.inf, cost).astype(np.float32) for name, cost in costs.items()}


def graph(cost: np.ndarray, resolution: float) -> csr_matrix:
    """Half of the undirected 16-neighbour graph; an edge costs the mean of the cells it touches."""
    rows, columns = cost.shape
    index = np.arange(cost.size).reshape(cost.shape)
    # Per move: the cells that the step touches, as offsets from its start.
    moves = {(0, 1): [(0, 0), (0, 1)], (1, 0): [(0, 0), (1, 0)]}
    for side in (-1, 1):
        moves[1, side] = [(0, 0), (0, side), (1, 0), (1, side)]
        moves[2, side] = [(0, 0), (1, 0), (1, side), (2, side)]
        moves[1, 2 * side] = [(0, 0), (0, side), (1, side), (1, 2 * side)]
    sources, targets, weights = [], [], []
    for (a, b), touched in moves.items():
        i, j = np.meshgrid(np.arange(rows - a), np.arange(max(0, -b), columns - max(0, b)), indexing="ij")
        mean = np.mean([cost[i + p, j + q] for p, q in touched], axis=0, dtype=float)
        open_edge = np.isfinite(mean)
        sources.append(index[i, j][open_edge])
        targets.append(index[i + a, j + b][open_edge])
        weights.append(mean[open_edge] * np.hypot(a, b) * resolution)
    ends = np.concatenate(sources), np.concatenate(targets)
    return csr_matrix((np.concatenate(weights), ends), shape=(cost.size, cost.size))


def worst_error(costs: np.ndarray, solution: Solution, grid: GridSpec) -> float:
    """Largest relative difference from Dijkstra over every eighth map."""
    worst = 0.0
    for n in range(0, len(solution.value.goal), 8):
        cell = np.floor(np.asarray(solution.value.goal[n]) / grid.resolution).astype(int)
        seed = costs[n][tuple(cell)] * solution.value.goal_offset[n]
        source = cell @ [grid.columns, 1]
        expected = seed + dijkstra(graph(costs[n], grid.resolution), directed=False, indices=source)
        found = np.asarray(solution.value.cost[n]).ravel()
        reached = np.isfinite(expected)
        if np.any(found[~reached] != UNREACHABLE):
            raise RuntimeError(f"Map {n}: the solver and Dijkstra disagree on which cells reach the goal.")
        worst = max(worst, float(np.max(np.abs(found / expected - 1)[reached & (expected > 0)])))
    return worst


def measure(options: Options) -> Iterator[Group]:
    """All figures of this benchmark."""
    for size in SIZES[:1] if options.quick else SIZES:
        grid = GridSpec(x_min=0.0, y_min=0.0, resolution=0.05, rows=size, columns=size)
        rng = np.random.default_rng(0)
        goals = jnp.asarray(rng.uniform(0, grid.x_max, (BATCH, 2)), jnp.float32)
        single = jax.jit(partial(cost_to_go, grid=grid))
        batched = jax.jit(jax.vmap(partial(cost_to_go, grid=grid)))
        work = Work(bytes=8.0 * size * size)
        for name, maps in benchmark_maps(size, grid.resolution, rng).items():
            costs = jnp.asarray(maps)

            def judge(solution: Solution, maps: np.ndarray = maps, grid: GridSpec = grid) -> dict[str, float]:
                many = solution if np.ndim(solution.status) else jax.tree.map(lambda leaf: leaf[None], solution)
                return {"worst relative error": worst_error(maps, many, grid)}

            goal = np.asarray(single(costs[0], goals[0]).value.goal)
            source = np.floor(goal / grid.resolution).astype(int) @ [size, 1]
            ready = partial(dijkstra, graph(maps[0], grid.resolution), directed=False, indices=source)
            rows = [
                Contender("ours, one map", "ours", partial(single, costs[0], goals[0]), 1, judge, work),
                Contender(f"ours, {BATCH} side by side", "ours", partial(batched, costs, goals), BATCH, judge, work),
                Contender("SciPy's Dijkstra, graph ready-made", "peer", ready, compiles=False),
            ]
            yield contest(f"{size} x {size}, {name}", "a map", rows, 3 if options.quick else 7)


if __name__ == "__main__":
    options = tyro.cli(Options, description=__doc__)
    present(measure(options), options)
