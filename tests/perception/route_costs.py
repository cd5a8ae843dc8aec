"""Costs of routes by SciPy's Dijkstra, on a graph that is built edge by edge from the definition."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from iwalker_jax.perception.cost_to_go import UNREACHABLE


def touched_cells(i, j, a, b):
    """Cells crossed by the segment from (i, j) to (i + a, j + b), found by sampling it densely off its ends.

    A diagonal passes exactly between two cells; they are added because a body has a width.
    """
    t = (np.arange(4000) + 0.5) / 4000
    cells = {(int(x), int(y)) for x, y in zip(np.floor(i + a * t + 0.5), np.floor(j + b * t + 0.5))}
    return cells | {(i + a, j), (i, j + b)} if abs(a) == abs(b) == 1 else cells


def dijkstra_costs(cost, goal_cell, resolution):
    """Oracle: the graph built edge by edge, solved by SciPy."""
    rows, columns = cost.shape
    sources, targets, weights = [], [], []
    moves = [(0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (1, -2), (2, 1), (2, -1)]
    touched = {move: touched_cells(0, 0, *move) for move in moves}
    for i, j in np.ndindex(rows, columns):
        for a, b in moves:
            if not (0 <= i + a < rows and 0 <= j + b < columns):
                continue
            mean = np.mean([cost[i + p, j + q] for p, q in touched[a, b]])
            if mean < UNREACHABLE:
                sources.append(i * columns + j)
                targets.append((i + a) * columns + j + b)
                weights.append(mean * np.hypot(a, b) * resolution)
    graph = coo_matrix((weights, (sources, targets)), shape=(cost.size, cost.size)).tocsr()
    return dijkstra(graph, directed=False, indices=goal_cell[0] * columns + goal_cell[1]).reshape(cost.shape)
