"""Closed-loop episodes as seen from above: the scene in plan, goals, the way walked, footprints and the last plan."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Polygon, Rectangle
from numpy.typing import ArrayLike

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure
from iwalker_jax.geometry import host
from iwalker_jax.navigation import EpisodeRecord, Outcome
from iwalker_jax.perception import DEFAULT_OBSTACLES
from iwalker_jax.scenes import Scene
from iwalker_jax.tasks import Task

_MARGIN = 0.15
_HANDLES = (
    Line2D([], [], color="tab:cyan", lw=1.3, label="last planned path"),
    Line2D([], [], color="magenta", marker="*", ls="", ms=9, label="goals"),
    Line2D([], [], color="black", marker="^", ls="", ms=6, label="start"),
)
"""What every picture of an episode shows."""

_STANDING = 0.004
"""[m] that a standing foot may move between two frames."""


def save_episode(task: Task, episode: EpisodeRecord, file: Path) -> None:
    """Write a PNG of one episode, the way walked coloured by time.

    Args:
        task: that was given.
        episode: one, as from `row_of`.
        file: PNG to write; its folder is created.

    Raises:
        InputError: a file that cannot be written.
    """
    width, height = _extent(task.scene)
    size = 8.0 * np.array([width, height]) / max(width, height)
    figure, axis = pyplot().subplots(figsize=(size[0] + 1.4, size[1] + 0.9), layout="constrained")
    line = draw_episode(axis, task, episode, by_time=True)
    figure.colorbar(line, ax=axis, label="time [s]", shrink=0.8, aspect=30)
    axis.set_title(f"{task.name}: {_caption(episode)}", fontsize=10)
    axis.set_xlabel("x [m]", fontsize=8)
    axis.set_ylabel("y [m]", fontsize=8)
    axis.tick_params(labelsize=7)
    feet = [
        Line2D([], [], color=FOOT_COLOURS[foot], marker=".", ls="", ms=4, label=f"{foot} foot") for foot in FOOT_COLOURS
    ]
    outcome = Outcome(int(episode.outcome[-1]))
    ended = [] if outcome is Outcome.REACHED else [Line2D([], [], color=outcome.colour, marker="X", ls="", label="end")]
    _add_legend(figure, [*_HANDLES, *feet, *ended])
    save_figure(figure, file)


def save_episode_grid(
    tasks: Sequence[Task], episodes: Sequence[EpisodeRecord], file: Path, title: str = "", columns: int = 4
) -> None:
    """Write a PNG with many episodes, the ways coloured by how they ended.

    Args:
        tasks: that were given.
        episodes: one for each task, as from `row_of`.
        file: PNG to write; its folder is created.
        title: above all of them.
        columns: most panels in a row.

    Raises:
        InputError: no episodes, another number of tasks, or a file that cannot be written.
    """
    if not episodes or len(tasks) != len(episodes):
        raise InputError(f"There are {len(episodes)} episodes and {len(tasks)} tasks; give at least one, a task each.")
    columns = min(columns, len(episodes))
    rows = -(-len(episodes) // columns)
    shapes = np.array([_extent(task.scene) for task in tasks])
    width = 14.0 / max(columns, 2)
    height = width * float(np.clip(np.median(shapes[:, 1] / shapes[:, 0]), 0.3, 1.5)) + 0.3
    figure, axes = pyplot().subplots(
        rows, columns, figsize=(width * columns, height * rows + 0.7), squeeze=False, layout="constrained"
    )
    for axis in axes.flat[len(episodes) :]:
        axis.set_axis_off()
    for axis, task, episode in zip(axes.flat, tasks, episodes):
        draw_episode(axis, task, episode)
        outcome = Outcome(int(episode.outcome[-1]))
        axis.set_title(f"{task.name}: {_caption(episode)}", fontsize=8, color=outcome.colour)
        axis.set_xticks([])
        axis.set_yticks([])
    seen = [kind for kind in Outcome if any(int(e.outcome[-1]) == kind for e in episodes)]
    handles = [Line2D([], [], color=kind.colour, lw=2.5, label=kind.word) for kind in seen]
    _add_legend(figure, [*handles, *_HANDLES])
    if title:
        figure.suptitle(title, fontsize=11)
    save_figure(figure, file)


def draw_episode(axis: Axes, task: Task, episode: EpisodeRecord, by_time: bool = False) -> LineCollection:
    """Draw one episode in plan, x to the right and y up, and return the line of the way walked."""
    draw_scene(axis, task.scene)
    for foot, place in zip(("right", "left"), np.moveaxis(np.asarray(episode.feet), 1, 0)):
        prints = footprints(place)
        axis.plot(prints[:, 0], prints[:, 1], ".", color=FOOT_COLOURS[foot], markersize=1.6, alpha=0.8, zorder=3)
    path = in_true_world(episode.path[-1], episode, len(episode.time) - 1)
    axis.plot(path[:, 0], path[:, 1], "-", color="tab:cyan", linewidth=1.3, zorder=4)
    outcome = Outcome(int(episode.outcome[-1]))
    places = np.asarray(episode.base)[:, :2]
    pieces = list(np.stack([places[:-1], places[1:]], axis=1))
    line = LineCollection(pieces, linewidths=1.9, capstyle="round", zorder=5)
    if by_time:
        line.set_array(np.asarray(episode.time)[1:])
        line.set_cmap("viridis")
    else:
        line.set_color(outcome.colour)
    axis.add_collection(line)
    x, y, yaw = task.start
    axis.plot(x, y, marker=(3, 0, np.degrees(yaw) - 90.0), color="black", markersize=8, zorder=6)
    if outcome is not Outcome.REACHED:
        axis.plot(*places[-1], "X", color=outcome.colour, mec="white", mew=0.8, markersize=9, zorder=8)
    for number, (x, y) in enumerate(task.goals, start=1):
        axis.plot(x, y, "*", color="magenta", mec="white", mew=0.6, markersize=13, zorder=7)
        if len(task.goals) > 1:
            axis.annotate(
                str(number), (x, y), (6, 5), textcoords="offset points", fontsize=7, color="darkmagenta", zorder=9
            )
    return line


def draw_scene(axis: Axes, scene: Scene) -> None:
    """Draw a scene in plan: dark what reaches into the body's height, pale what only lies above or below it."""
    x_min, y_min, x_max, y_max = scene.bounds
    floor = Rectangle((x_min, y_min), x_max - x_min, y_max - y_min, facecolor="#f6f5f1", edgecolor="0.6", lw=0.8)
    axis.add_patch(floor)
    boxes, cylinders = scene.boxes, scene.cylinders
    patches = [Polygon(box_corners(row)) for row in boxes] + [Circle((x, y), r) for x, y, _, r, _ in cylinders]
    centre = np.concatenate([boxes[:, 2], cylinders[:, 2]])
    half = np.concatenate([boxes[:, 5], cylinders[:, 4]])
    low, high = DEFAULT_OBSTACLES.min_height, DEFAULT_OBSTACLES.max_height
    in_the_way = (centre - half < high) & (centre + half > low)
    for solid, face, edge, order in ((False, "#e3e1da", "#c9c6bb", 1), (True, "#8b8f98", "#5d616b", 2)):
        chosen = [patch for patch, inside in zip(patches, in_the_way) if inside == solid]
        axis.add_collection(PatchCollection(chosen, facecolor=face, edgecolor=edge, linewidth=0.6, zorder=order))
    axis.set_xlim(x_min - _MARGIN, x_max + _MARGIN)
    axis.set_ylim(y_min - _MARGIN, y_max + _MARGIN)
    axis.set_aspect("equal")


def box_corners(box: Float[np.ndarray, " 7"]) -> Float[np.ndarray, "4 2"]:
    """Corners [m] of a scene's box in plan."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * box[3:5]
    return host.to_world(box[[0, 1, 6]], corners)


def footprints(foot: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "k 2"]:
    """Where one foot stood: places [m] at which it stopped moving."""
    still = np.linalg.norm(np.diff(foot, axis=0), axis=1) < _STANDING
    begins = still & ~np.concatenate([[False], still[:-1]])
    return foot[:-1][begins][:, :2]


def in_true_world(points: ArrayLike, episode: EpisodeRecord, frame: int) -> Float[np.ndarray, "n 2"]:
    """Points (n, 2) [m] of a frame's plan, made in the world as the robot believes it to be, in the true one.

    A frame's plan and believed pose belong to its beginning, which is the end of the frame before.
    """
    own = host.to_base(np.asarray(episode.believed[frame]), np.asarray(points))
    return host.to_world(np.asarray(episode.base[max(frame - 1, 0)]), own)


def _add_legend(figure: Figure, handles: Sequence[Line2D]) -> None:
    """A legend below all axes."""
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 6), fontsize=8, frameon=False)


def _caption(episode: EpisodeRecord) -> str:
    return f"{Outcome(int(episode.outcome[-1])).word}, {float(episode.time[-1]):.0f} s"


def _extent(scene: Scene) -> tuple[float, float]:
    x_min, y_min, x_max, y_max = scene.bounds
    return x_max - x_min + 2 * _MARGIN, y_max - y_min + 2 * _MARGIN
