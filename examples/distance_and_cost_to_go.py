"""Distance field, cost-to-go and route of a grid of your own: python examples/distance_and_cost_to_go.py.

Draw your map as text: # is an obstacle, S the start, G the goal; a cell is 0.25 m.
"""

import iwalker_jax as iw

iw.configure_runtime()

import jax.numpy as jnp
import numpy as np

from iwalker_jax.perception import TraversalParameters, descend, traversal_cost

MAP = """
........................
.S......................
..........########......
..........#.............
..........#.............
######....#......####...
..........#......#......
..........#......#...G..
.................#......
........................
"""
RESOLUTION = 0.25  # [m]


def main() -> None:
    cells = np.array([list(line) for line in MAP.split()])
    grid = iw.GridSpec(0.0, 0.0, RESOLUTION, *cells.shape)
    start, goal = (jnp.asarray(RESOLUTION * (np.argwhere(cells == mark)[0] + 0.5)) for mark in "SG")
    distance = iw.signed_distance_field(jnp.asarray(cells == "#"), RESOLUTION)
    print(f"Clearance at the start {distance[1, 1]:.2f} m, deepest inside an obstacle {float(distance.min()):.2f} m")

    body = TraversalParameters()
    cost = traversal_cost(distance, jnp.zeros(grid.shape), body)
    solution = iw.cost_to_go(jnp.where(distance < body.body_radius, jnp.inf, cost), goal, grid)
    print(iw.describe(int(solution.status)))
    print(f"From the start it costs as much as {float(solution.value.cost[1, 1]):.2f} m in the open.")
    route = descend(solution.value.cost, grid, start, 2 * max(grid.shape))
    for x, y in jnp.concatenate([route, (route[1:] + route[:-1]) / 2]).tolist():
        cell = int(x / RESOLUTION), int(y / RESOLUTION)
        cells[cell] = cells[cell] if cells[cell] in "SG" else "*"
    print("\n".join("".join(row) for row in cells))


if __name__ == "__main__":
    main()
