"""A whole floor of an office, 44 m x 26 m: rooms along two corridors, with hundreds of pieces of furniture."""

import numpy as np

from iwalker_jax.scenes.scene import Scene

WIDTH, DEPTH = 44.0, 26.0
CORRIDORS = ((6.0, 11.0), (15.0, 20.0))
"""[m] y from and to which they reach; no furniture stands in them."""


def office_floor(count: int, seed: int = 0) -> Scene:
    """A floor of that many boxes, at least 77; every room has a door to a corridor."""
    rng = np.random.default_rng(seed)
    rows = [[WIDTH / 2, y, 1.25, WIDTH / 2, 0.05, 1.25, 0.0] for y in (-0.05, DEPTH + 0.05)] + [
        [x, DEPTH / 2, 1.25, 0.05, DEPTH / 2, 1.25, 0.0] for x in (-0.05, WIDTH + 0.05)
    ]
    walls = [y for corridor in CORRIDORS for y in corridor]
    rows += [[x + 1.5, y, 1.25, 1.5, 0.05, 1.25, 0.0] for y in walls for x in np.arange(0.0, WIDTH, 4.0)]
    between = ((0.0, walls[0]), (walls[1], walls[2]), (walls[3], DEPTH))
    rows += [
        [x, (low + high) / 2, 1.25, 0.05, (high - low) / 2, 1.25, 0.0]
        for x in np.arange(4.0, WIDTH, 4.0)
        for low, high in between
    ]
    while len(rows) < count:
        x, y = rng.uniform([0.5, 0.5], [WIDTH - 0.5, DEPTH - 0.5])
        if all(not low - 1 < y < high + 1 for low, high in CORRIDORS):
            half = rng.uniform([0.05, 0.05, 0.1], [0.4, 0.4, 0.6])
            rows.append([x, y, half[2], *half, rng.uniform(0, 3)])
    return Scene("floor", "test", np.array(rows), np.empty((0, 5)), (0.0, 0.0, WIDTH, DEPTH), 2.5)
