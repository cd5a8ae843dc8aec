"""Whether a task can be done at all: its start and goals lie in the scene, have room, and hang together."""

import cv2
import numpy as np
from jaxtyping import Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.scenes.clearance_grid import ClearanceGrid, clearance_grid
from iwalker_jax.tasks.routes import clearances, single_precision
from iwalker_jax.tasks.task import Task

_CELL = 0.05
"""[m] fine enough that a gap some centimetres wider than the body is not lost between two cells."""


def check_task(task: Task, unreachable: bool = False) -> None:
    """Require a start and goals where the robot fits, and a way as wide as its body from each to the next.

    Args:
        task: to be walked.
        unreachable: accept goals that no way leads to, for the robot to find out.

    Raises:
        InputError: names the place, what is wrong with it, and the nearest place that would do.
    """
    places = np.concatenate([[task.start[:2]], task.goals])
    kinds = ["start"] + ["goal"] * len(task.goals)
    for kind, place in zip(kinds, places, strict=True):
        _check_inside(task, kind, place)
    grid = clearance_grid(task.scene, _CELL, 2 * BODY.route_radius)
    roomy = grid.distance >= BODY.route_radius
    # In single precision, and with a rounding's leave.
    spare = clearances(single_precision(task.scene), places) - BODY.route_radius + 1e-5
    for kind, place, left in zip(kinds, places, spare.tolist(), strict=True):
        if left < 0:
            clearance = left + BODY.route_radius
            where = "inside an obstacle" if clearance <= 0 else f"{100 * clearance:.0f} cm from an obstacle"
            raise InputError(
                f"The {kind} at {_words(place)} in {task.scene.name} is {where}; give a {kind} that is "
                f"{100 * BODY.route_radius:.0f} cm from all of them{_nearest(grid, roomy, place)}."
            )
    if unreachable:
        return
    regions = cv2.connectedComponents((grid.distance >= BODY.radius).astype(np.uint8), connectivity=8)[1]
    own = _region(grid, regions, places[0])
    for goal in task.goals:
        if _region(grid, regions, goal) != own:
            raise InputError(
                f"No way as wide as the robot, {200 * BODY.radius:.0f} cm, leads from {_words(places[0])} to the goal "
                f"at {_words(goal)} in {task.scene.name}{_nearest(grid, roomy & (regions == own), goal)}; give another "
                "goal, or let the robot find out with the option unreachable."
            )


def _check_inside(task: Task, kind: str, place: Float[np.ndarray, "2"]) -> None:
    x_min, y_min, x_max, y_max = task.scene.bounds
    if not (x_min <= place[0] <= x_max and y_min <= place[1] <= y_max):
        raise InputError(
            f"The {kind} at {_words(place)} is outside {task.scene.name}, which reaches from {x_min:.5g}, {y_min:.5g} "
            f"to {x_max:.5g}, {y_max:.5g} [m]; give a {kind} inside."
        )


def _region(grid: ClearanceGrid, regions: np.ndarray, place: Float[np.ndarray, "2"]) -> int:
    """The region of the free cell nearest to a place."""
    cells = np.argwhere(regions > 0)
    nearest = cells[np.argmin(np.sum((grid.centres(cells) - place) ** 2, axis=1))] if len(cells) else (0, 0)
    return int(regions[tuple(nearest)])


def _nearest(grid: ClearanceGrid, fits: Bool[np.ndarray, "rows columns"], place: Float[np.ndarray, "2"]) -> str:
    """Where the nearest of some cells lies, in words; nothing if there is none."""
    cells = np.argwhere(fits)
    if not len(cells):
        return ""
    centres = grid.centres(cells)
    return f" (the nearest is {_words(centres[np.argmin(np.sum((centres - place) ** 2, axis=1))])})"


def _words(place: Float[np.ndarray, "2"]) -> str:
    return ", ".join(f"{value:.5g}" for value in place)
