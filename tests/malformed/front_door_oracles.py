"""What a right answer of a function by the front door looks like, computed with NumPy and SciPy in double precision.

Each oracle takes the arguments by name and the answer, and says what is wrong with it; None if nothing is.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.ndimage import distance_transform_edt

from iwalker_jax.perception.cost_to_go import UNREACHABLE
from tests.perception.route_costs import dijkstra_costs

Oracle = Callable[[Mapping[str, Any], Any], str | None]

_CLOSE = 1e-2
"""Relative error that is told apart from rounding, whatever a problem's scale is."""


def doubles(*values: Any) -> list[np.ndarray]:
    """Arrays in double precision, of the numbers that single precision holds."""
    return [np.asarray(np.asarray(value, np.float32), np.float64) for value in values]


def optimal_program(given: Mapping[str, Any], point: Any) -> str | None:
    """The optimality conditions of a quadratic program, relative to the largest of their terms."""
    P, q, C, low, high = doubles(*(given[name] for name in ("P", "q", "C", "low", "high")))
    P, (x, y) = P / 2 + P.T / 2, doubles(point.x, point.y)
    if np.linalg.eigvalsh(P)[0] < -1e-3 * np.abs(P).max():
        return "a minimum of a cost that curves downwards"
    terms = np.abs(P) @ np.abs(x) + np.abs(q) + np.abs(C.T) @ np.abs(y)
    if (np.abs(P @ x + q + C.T @ y) > _CLOSE * terms.max()).any():
        return "the cost still falls"
    row = C @ x
    reach = np.abs(C) @ np.abs(x)
    bound = np.where(row > high, high, low)
    if (np.maximum(row - high, low - row) > _CLOSE * (reach + np.abs(bound))).any():
        return "a constraint is violated"
    return None


def tracked_path(given: Mapping[str, Any], plan: Any) -> str | None:
    """A unicycle's motion from the initial state, which costs no more than to keep speed and heading."""
    reference, start = doubles(given["reference"], given["initial_state"])
    states, controls = doubles(plan.states, plan.controls)
    size = np.abs(states).max() + 1e-3
    x, y, v, theta = states.T
    # In single precision a large angle's cosine says little, and a sum keeps the rounding of its largest term.
    if np.abs(theta).max() < 1e3:
        motion = np.stack([x + v * np.cos(theta), y + v * np.sin(theta)], axis=1)[:-1]
        if np.abs(states[1:, :2] - motion).max() > _CLOSE * size:
            return "no motion of a unicycle"
    if np.abs(np.diff(v) - controls[:, 1]).max() > _CLOSE * size or np.abs(states[0] - start).max() > _CLOSE * size:
        return "speeds or a start that the controls do not give"
    steps = np.arange(len(reference))[:, None] * start[2] * np.array([np.cos(start[3]), np.sin(start[3])])
    idle = np.sum((start[:2] + steps - reference) ** 2)
    weights = doubles(given.get("weights", [1.0, 1000.0, 5000.0]))[0]
    cost = weights[0] * np.sum((states[:, :2] - reference) ** 2) + weights[1:] @ np.sum(controls**2, axis=0)
    return (
        f"costs {cost:.3g}, and {weights[0] * idle:.3g} without any control"
        if cost > 1.01 * weights[0] * idle + 1e-3
        else None
    )


def summed_steps(given: Mapping[str, Any], plan: Any) -> str | None:
    """Footsteps that are the sums of the steps, from where the stance foot is; the COM above its foot."""
    state, steps = doubles(given["initial_state"], plan.inputs)
    footsteps, states = doubles(plan.footsteps, plan.states)
    size = max(np.abs(part).max() for part in (state, footsteps, states)) + 1e-3
    if np.abs(state[:, 0] - state[:, 1] + np.cumsum(steps, axis=0) - footsteps).max() > _CLOSE * size:
        return "footsteps that the steps do not give"
    return (
        "a COM that is not above its foot"
        if np.abs(states[..., 0] - states[..., 1] - footsteps).max() > _CLOSE * size
        else None
    )


def exact_distances(given: Mapping[str, Any], field: Any) -> str | None:
    """SciPy's distances, both ways, less half a cell."""
    occupied, side = np.asarray(given["occupied"], bool), float(given["resolution"])
    if occupied.all() or not occupied.any():
        wanted = np.full(occupied.shape, np.hypot(*occupied.shape)) * np.where(occupied, -1, 1)
    else:
        wanted = distance_transform_edt(~occupied) - distance_transform_edt(occupied)
        wanted -= np.sign(wanted) / 2
    return None if np.allclose(field, side * wanted, rtol=1e-4, atol=1e-4 * side) else "other distances than SciPy's"


def shortest_routes(given: Mapping[str, Any], value: Any) -> str | None:
    """Costs of SciPy's Dijkstra on the same graph, and the way from the goal's cell to the goal."""
    grid, cost = given["grid"], doubles(given["traversal_cost"])[0]
    cost = np.where((cost > 0) & (cost < UNREACHABLE), cost, np.inf)
    cell = tuple(np.round(((doubles(value.goal)[0] - (grid.x_min, grid.y_min)) / grid.resolution) - 0.5).astype(int))
    wanted = dijkstra_costs(cost, cell, grid.resolution) + float(value.goal_offset) * cost[cell]
    found, reached = np.asarray(value.cost, np.float64), wanted < UNREACHABLE
    right = np.allclose(found[reached], wanted[reached], rtol=1e-3) and (found[~reached] == UNREACHABLE).all()
    return None if right else "other costs than Dijkstra's"


def one_kind_of_cell(given: Mapping[str, Any], maps: Any) -> str | None:
    """Every cell is occupied, known free, or unknown, and what is occupied is at no positive distance."""
    kinds = np.sum([maps.occupied, maps.known_free, maps.unknown], axis=0)
    if (kinds != 1).any():
        return "cells of several kinds, or of none"
    return None if ((np.asarray(maps.esdf) < 0) == np.asarray(maps.occupied)).all() else "distances of another map"


def plan_from_here(given: Mapping[str, Any], plan: Any) -> str | None:
    """A path from the origin through its waypoints' last, no farther than the network looks, and footsteps along it."""
    path, footsteps, waypoints = doubles(plan.path, plan.footsteps, plan.waypoints)
    if np.abs(path[0]).max() > 1e-3 or np.abs(path[-1] - waypoints[-1]).max() > 1e-2:
        return "a path that does not lead from the robot to its last waypoint"
    return "a plan over many metres" if max(np.abs(path).max(), np.abs(footsteps).max()) > 30 else None
