"""One plan as a picture: what the camera saw with path and footsteps on the floor, and the same from above."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from numpy.typing import ArrayLike

from bruce_model.parameters import FOOT
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure, show_on_ground
from iwalker_jax.evaluation.projection import floor_pixels
from iwalker_jax.geometry import Side, path_tangents, side_of_step
from iwalker_jax.perception import DEFAULT_GRID, CameraMount, Intrinsics, LocalMap, build_local_map, camera_pose
from iwalker_jax.perception.depth_cleanup import check_depth_image, check_image_size
from iwalker_jax.planning import Plan

_FAR = 6.0  # [m] at the end of the depth's colours
_NEAR = 0.1  # [m] in front of the camera where drawing ends
_HIDDEN = (0.08, 0.03)  # [m], [m/m^2] by which depth noise lets the floor lie behind what was measured
_PATH_WIDTH = 0.03  # [m] of the ribbon that stands for the path
_FOOT_WIDTH = 0.04  # [m]
_LEAST_GROUND = np.array([[-0.4, -1.2], [2.6, 1.2]])  # [m] corners of what is always shown from above
_BEYOND = 1.0  # [m] from the path's reach to the farthest goal that widens the view
_EDGE = 0.15  # [m] between a goal and the edge of the ground shown
_PATH_COLOUR, _GOAL_COLOUR = "#e8352b", "magenta"
_FREE, _UNKNOWN, _OCCUPIED = (1.0, 1.0, 1.0), (0.86, 0.86, 0.84), (0.36, 0.38, 0.42)


def draw_plan(
    depth: ArrayLike,
    plan: Plan,
    file: str | Path,
    goal: ArrayLike | Sequence[float] | None = None,
    mount: CameraMount = CameraMount(),
    intrinsics: Intrinsics = Intrinsics(),
) -> None:
    """Write a PNG of one plan: the depth image with path and footsteps where the camera sees them, and the map.

    Args:
        depth: (height, width) z-depth [m]; 0, negative, NaN and inf: no return.
        plan: of this one image, as from `planner(depth, goal)`.
        file: PNG to write; its folder is created.
        goal: (2,) [m] in the base frame, if it is to be shown.
        mount: of the camera.
        intrinsics: of the image.

    Raises:
        InputError: for a batch of plans, an image of another size than its intrinsics', or a file that cannot be
            written.
    """
    image = np.asarray(depth)
    check_depth_image(image)
    check_image_size(image.shape, intrinsics)
    if np.ndim(plan.path) != 2:
        raise InputError(
            f"The plan's path has shape {np.shape(plan.path)}; draw one plan at a time, "
            "jax.tree.map(lambda leaf: leaf[k], plan) of a batch."
        )
    scene = _Drawn(
        np.where(np.isfinite(image) & (image > 0), image, 0.0).astype(np.float32),
        np.asarray(plan.path, np.float64),
        _footprints(plan),
        side_of_step(int(plan.first_swing), np.arange(len(plan.footsteps))) == Side.LEFT,
        None if goal is None else np.asarray(goal, np.float64),
    )
    local_map = _map_of(jnp.asarray(image, jnp.float32), mount.as_array(), intrinsics)
    figure = pyplot().figure(figsize=(15.0, 6.2), layout="compressed")
    camera, above = figure.subplots(1, 2, width_ratios=(1.75, 1.0))
    _draw_camera_view(camera, scene, mount, intrinsics)
    _draw_from_above(above, scene, local_map, mount, intrinsics)
    handles, labels = above.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), fontsize=9, frameon=False)
    save_figure(figure, Path(file))


class _Drawn(NamedTuple):
    """What is drawn, base frame: depth [m] with 0 for no return, path (n, 2), corners of the footprints (m, 4, 2) [m],
    which of them are left ones, and the goal (2,)."""

    depth: Float[np.ndarray, "h w"]
    path: Float[np.ndarray, "n 2"]
    feet: Float[np.ndarray, "m 4 2"]
    left: Bool[np.ndarray, " m"]
    goal: Float[np.ndarray, " 2"] | None


_map_of = jax.jit(build_local_map, static_argnums=2)


def _footprints(plan: Plan) -> Float[np.ndarray, "m 4 2"]:
    """Corners of feet that stand at the footsteps and point along the path beside them."""
    path, places = np.asarray(plan.path, np.float64), np.asarray(plan.footsteps, np.float64)
    nearest = np.argmin(np.linalg.norm(places[:, None] - path[None], axis=-1), axis=1)
    ahead = np.asarray(path_tangents(jnp.asarray(plan.path)), np.float64)[nearest]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    half = (FOOT.toe - FOOT.heel) / 2
    corners = ((half, 0.5), (half, -0.5), (-half, -0.5), (-half, 0.5))
    return np.stack([places + along * ahead + _FOOT_WIDTH * across * left for along, across in corners], axis=1)


def _ribbon(path: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "k 4 2"]:
    """The path as short strips of floor."""
    steps = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1)))
    fine = np.linspace(0.0, steps[-1], 4 * len(path))
    line = np.stack([np.interp(fine, steps, path[:, k]) for k in range(2)], axis=1)
    ahead = np.gradient(line, axis=0)
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    aside = 0.5 * _PATH_WIDTH * np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    right, left = line - aside, line + aside
    return np.stack([right[:-1], left[:-1], left[1:], right[1:]], axis=1)


def seen_pixels(
    shapes: Float[np.ndarray, "k corners 2"],
    depth: Float[np.ndarray, "h w"],
    mount: CameraMount,
    intrinsics: Intrinsics,
) -> tuple[Float[np.ndarray, "k corners 2"], Bool[np.ndarray, " k"]]:
    """Pixels of shapes on the floor, and which shapes lie before the camera with nothing in between.

    Args:
        shapes: corners [m] on the floor, base frame.
        depth: z-depth [m], 0 for no return.
        mount: of the camera.
        intrinsics: of the image.
    """
    R_base_camera, p_base_camera = (np.asarray(part, np.float64) for part in camera_pose(mount.as_array()))
    pixels, distance, ahead = floor_pixels(shapes, R_base_camera, p_base_camera, intrinsics, _NEAR)
    column, row = np.moveaxis(np.round(pixels.mean(axis=1)).astype(int), 1, 0)
    inside = (column >= 0) & (column < intrinsics.width) & (row >= 0) & (row < intrinsics.height)
    measured = depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    hidden = (measured > 0) & (distance.mean(axis=1) > measured + _HIDDEN[0] + _HIDDEN[1] * measured**2)
    return pixels, ahead.all(axis=1) & inside & ~hidden


def _draw_camera_view(axis: Axes, scene: _Drawn, mount: CameraMount, intrinsics: Intrinsics) -> None:
    shown = np.ma.masked_equal(scene.depth, 0.0)
    axis.set_facecolor("0.15")
    image = axis.imshow(shown, vmin=0.0, vmax=_FAR, cmap="viridis_r", interpolation="nearest")
    axis.figure.colorbar(image, ax=axis, label="depth [m]", extend="max", shrink=0.85, aspect=30, pad=0.01)
    strips, seen = seen_pixels(_ribbon(scene.path), scene.depth, mount, intrinsics)
    axis.add_collection(PolyCollection(list(strips[seen]), facecolor=_PATH_COLOUR, edgecolor=_PATH_COLOUR, lw=0.6))
    feet, seen = seen_pixels(scene.feet, scene.depth, mount, intrinsics)
    for left, side in ((True, "left"), (False, "right")):
        chosen = list(feet[seen & (scene.left == left)])
        axis.add_collection(PolyCollection(chosen, facecolor=FOOT_COLOURS[side], edgecolor="white", lw=0.9, zorder=3))
    if scene.goal is not None:
        star, seen = seen_pixels(scene.goal[None, None], scene.depth, mount, intrinsics)
        if seen[0]:
            axis.plot(*star[0, 0], "*", color=_GOAL_COLOUR, mec="white", mew=0.8, ms=16, zorder=4)
    axis.set_xlim(-0.5, intrinsics.width - 0.5)
    axis.set_ylim(intrinsics.height - 0.5, -0.5)
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title("what the camera sees", fontsize=10)


def _draw_from_above(
    axis: Axes, scene: _Drawn, local_map: LocalMap, mount: CameraMount, intrinsics: Intrinsics
) -> None:
    colours = np.empty((*DEFAULT_GRID.shape, 3))
    colours[...] = _FREE
    colours[np.asarray(local_map.unknown)] = _UNKNOWN
    colours[np.asarray(local_map.occupied)] = _OCCUPIED
    show_on_ground(axis, colours)
    _draw_field_of_view(axis, mount, intrinsics)
    axis.plot(scene.path[:, 1], scene.path[:, 0], "-", color=_PATH_COLOUR, lw=2.0, label="path", zorder=3)
    for left, side in ((True, "left"), (False, "right")):
        corners = [foot[:, ::-1] for foot in scene.feet[scene.left == left]]
        label = f"{side} footsteps"
        colour = FOOT_COLOURS[side]
        axis.add_collection(PolyCollection(corners, facecolor=colour, edgecolor="white", lw=0.5, zorder=4, label=label))
    axis.plot(0, 0, "^", color="black", ms=9, label="robot", ls="", zorder=5)
    low, high = _shown_ground(scene)
    if scene.goal is not None:
        _draw_goal(axis, scene.goal, low + _EDGE, high - _EDGE)
    axis.set_xlim(high[1], low[1])
    axis.set_ylim(low[0], high[0])
    axis.set_xlabel("y [m], left", fontsize=8)
    axis.set_ylabel("x [m], ahead", fontsize=8)
    axis.tick_params(labelsize=8)
    axis.set_title("from above: obstacles dark, unseen grey", fontsize=10)


def _shown_ground(scene: _Drawn) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " 2"]]:
    """Corners [m] of the ground shown from above: around the path, and the goal if it is not far beyond it."""
    points = np.concatenate([scene.path, _LEAST_GROUND])
    if scene.goal is not None:
        reach = np.linalg.norm(points, axis=1).max() + _BEYOND
        points = np.concatenate([points, scene.goal[None]]) if np.linalg.norm(scene.goal) < reach else points
    half = np.abs(points[:, 1]).max() + 2 * _EDGE
    low, high = np.array([points[:, 0].min(), -half]), np.array([points[:, 0].max() + 2 * _EDGE, half])
    grid = DEFAULT_GRID
    return np.maximum(low, (grid.x_min, grid.y_min)), np.minimum(high, (grid.x_max, grid.y_max))


def _draw_goal(
    axis: Axes, goal: Float[np.ndarray, " 2"], low: Float[np.ndarray, " 2"], high: Float[np.ndarray, " 2"]
) -> None:
    """A star at the goal, or at the edge towards one that lies beyond it."""
    room = np.where(goal > 0, high, low) / np.where(np.abs(goal) > 1e-6, goal, 1e-6)
    share = min(1.0, float(np.abs(room).min()))
    label = "goal" if share == 1.0 else f"to the goal, {np.linalg.norm(goal):.1f} m away"
    inside = _GOAL_COLOUR if share == 1.0 else "none"
    edge = "white" if share == 1.0 else _GOAL_COLOUR
    x, y = share * goal
    axis.plot(y, x, "*", mfc=inside, mec=edge, ms=16, label=label, ls="", zorder=5)


def _draw_field_of_view(axis: Axes, mount: CameraMount, intrinsics: Intrinsics) -> None:
    """Dotted lines from the camera along the image's left and right edge."""
    for column in (0, intrinsics.width - 1):
        aside = (intrinsics.cx - column) / intrinsics.fx
        x = mount.forward + np.array([0.0, DEFAULT_GRID.x_max])
        axis.plot(mount.left + aside * (x - mount.forward), x, ":", color="0.45", lw=0.9, zorder=2)
