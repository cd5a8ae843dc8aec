"""What a walking robot sees and plans, as panels of a film: its depth image and its map, both with the path."""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int, Int8, UInt8

from iwalker_jax.evaluation.projection import floor_pixels
from iwalker_jax.geometry import Side
from iwalker_jax.navigation import recorded_window
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import MapCell

Image = UInt8[np.ndarray, "height width 3"]

_RED, _ORANGE, _BLUE, _MAGENTA = (217, 38, 38), (240, 120, 20), (31, 119, 180), (214, 0, 190)
_INK, _GRID = (45, 45, 50), (208, 210, 206)
CELL_COLOURS = {MapCell.UNSEEN: (186, 190, 197), MapCell.FREE: (250, 249, 245), MapCell.OCCUPIED: (93, 97, 107)}
"""RGB of the map's cells."""

_FEET = {Side.RIGHT: _ORANGE, Side.LEFT: _BLUE}
_NO_RETURN = (38, 38, 42)
_FAR = 6.0  # [m] at the end of the depth's colours
_NEAR = 0.15  # [m] in front of the camera where lines are cut off
_REAR = 0.5  # [m] shown behind the robot
_LEGEND_SIZE = (1200, 32)  # [px] at which the legend is laid out
PAPER = (250, 250, 248)
_FRACTION = 4  # bits of OpenCV's sub-pixel coordinates


class PanelPlan(NamedTuple):
    """What is drawn besides the sensor's data, base frame.

    Attributes:
        path: (n, 2) [m]; footsteps: (m, 2) [m]; goal: (2,) [m].
        sides: (m,) the `Side` of each footstep.
    """

    path: Float[np.ndarray, "n 2"]
    footsteps: Float[np.ndarray, "m 2"]
    goal: Float[np.ndarray, " 2"]
    sides: Int[np.ndarray, " m"]


def depth_panel(
    depth: Float[np.ndarray, "h w"],
    plan: PanelPlan,
    R_base_camera: Float[np.ndarray, "3 3"],
    p_base_camera: Float[np.ndarray, " 3"],
    size: tuple[int, int],
    intrinsics: Intrinsics,
) -> Image:
    """A depth image [m] in colours, near bright and far dark, with path and goal where they lie on the floor.

    Args:
        depth: 0 where nothing was measured.
        plan: to draw.
        R_base_camera, p_base_camera: pose of the optical frame (x right, y down, z forward) in the base frame.
        size: (width, height) [px] of the panel.
        intrinsics: of the depth image.
    """
    metres = np.asarray(depth, np.float32)
    colours = cv2.applyColorMap((255 * (1 - np.clip(metres / _FAR, 0, 1))).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    colours = cv2.cvtColor(colours, cv2.COLOR_BGR2RGB)
    colours[~(metres > 0)] = _NO_RETURN
    image = cv2.resize(colours, size, interpolation=cv2.INTER_NEAREST)
    zoom = np.array(size) / np.array([intrinsics.width, intrinsics.height])

    def pixels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        image_points, _, ahead = floor_pixels(points, R_base_camera, p_base_camera, intrinsics, _NEAR)
        return (image_points + 0.5) * zoom, ahead

    line, ahead = pixels(plan.path)
    if ahead.any():
        _polyline(image, line[ahead], (255, 255, 255), 5)
        _polyline(image, line[ahead], _RED, 3)
    star, seen = pixels(plan.goal[None])
    if seen[0]:
        _star(image, star[0])
    return _labelled(image, "depth", light=True)


def map_panel(
    cells: Int8[np.ndarray, "rows columns"],
    middle: Float[np.ndarray, " 2"],
    pose: Float[np.ndarray, " 3"],
    plan: PanelPlan,
    size: tuple[int, int],
) -> Image:
    """The robot's map from above, forward up, with path, footsteps and where the goal lies.

    Args:
        cells: `MapCell`s of the map's window, whose axes are the world's; however many were recorded.
        middle: [m] where the robot believed to be when the window moved last.
        pose: (x [m], y [m], yaw [rad]) from where the map is seen.
        plan: to draw, in the base frame of that pose.
        size: (width, height) [px] of the panel; it is as wide as the window.
    """
    width, height = size
    count = len(cells)
    corner, resolution = recorded_window(middle, count)
    side = count * resolution
    scale = width / side

    def pixels(points: np.ndarray) -> np.ndarray:
        return np.stack([(side / 2 - points[:, 1]) * scale, height - (points[:, 0] + _REAR) * scale], axis=1)

    ahead = ((height - np.arange(height) - 0.5) / scale - _REAR)[:, None]
    left = (side / 2 - (np.arange(width) + 0.5) / scale)[None]
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    place = np.stack([pose[0] + cos * ahead - sin * left, pose[1] + sin * ahead + cos * left])
    cell = np.floor((place - corner[:, None, None]) / resolution).astype(int)
    inside = ((cell >= 0) & (cell < count)).all(axis=0)
    row, column = np.clip(cell, 0, count - 1)
    palette = np.array([CELL_COLOURS[kind] for kind in MapCell], np.uint8)
    image = palette[np.where(inside, cells[row, column], MapCell.UNSEEN)]
    origin = pixels(np.zeros((1, 2)))[0]
    for metres in range(1, 6):
        cv2.circle(image, _fixed(origin), round(metres * scale * 2**_FRACTION), _GRID, 1, cv2.LINE_AA, _FRACTION)
    _polyline(image, pixels(plan.path), _RED, 2)
    for place, foot in zip(pixels(plan.footsteps), plan.sides, strict=True):
        cv2.circle(image, _fixed(place), 3 * 2**_FRACTION, _FEET[Side(foot)], -1, cv2.LINE_AA, _FRACTION)
    _robot(image, origin)
    _goal(image, origin, pixels(plan.goal[None])[0])
    return _labelled(image, "map and plan")


def legend_strip(width: int, height: int) -> Image:
    """What the colours and signs of the panels mean, in one line as wide as the film."""
    entries: list[tuple[str, Sequence[int], str]] = [
        ("robot", _INK, "robot"),
        ("line", _RED, "planned path"),
        ("dot", _FEET[Side.RIGHT], "right footsteps"),
        ("dot", _FEET[Side.LEFT], "left footsteps"),
        ("star", _MAGENTA, "goal"),
        ("cell", CELL_COLOURS[MapCell.UNSEEN], "unseen"),
        ("cell", CELL_COLOURS[MapCell.FREE], "seen free"),
        ("cell", CELL_COLOURS[MapCell.OCCUPIED], "obstacle"),
    ]
    wide, tall = _LEGEND_SIZE
    strip = np.full((tall, wide, 3), PAPER, np.uint8)
    sizes = [cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.46, 1)[0][0] for *_, text in entries]
    gap = (wide - 24 - sum(sizes) - 30 * len(entries)) / (len(entries) - 1)
    left = 12.0
    for (sign, colour, text), size in zip(entries, sizes, strict=True):
        _sign(strip, sign, np.array([left + 11.0, tall / 2]), colour)
        draw_text(strip, text, (round(left) + 30, tall // 2 + 5), scale=0.46)
        left += 30 + size + gap
    return cv2.resize(strip, (width, height), interpolation=cv2.INTER_AREA)


def _sign(image: Image, sign: str, centre: np.ndarray, colour: Sequence[int]) -> None:
    if sign == "line":
        _polyline(image, centre + np.array([[-11.0, 0.0], [11.0, 0.0]]), colour, 3)
    elif sign == "dot":
        cv2.circle(image, _fixed(centre), 5 * 2**_FRACTION, tuple(colour), -1, cv2.LINE_AA, _FRACTION)
    elif sign == "star":
        _star(image, centre)
    elif sign == "robot":
        _robot(image, centre)
    else:
        low, high = (np.round(centre + shift).astype(int).tolist() for shift in ((-10, -7), (10, 7)))
        cv2.rectangle(image, low, high, tuple(colour), -1)
        cv2.rectangle(image, low, high, _INK, 1)


def draw_text(
    image: Image,
    text: str,
    corner: tuple[int, int],
    colour: Sequence[int] = _INK,
    scale: float = 0.5,
) -> None:
    """Write text from its lower left corner [px] into an image, in place."""
    cv2.putText(image, text, corner, cv2.FONT_HERSHEY_SIMPLEX, scale, tuple(colour), 1, cv2.LINE_AA)


def _labelled(image: Image, text: str, light: bool = False) -> Image:
    if light:
        width = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.46, 1)[0][0]
        image[:25, : width + 17] = _NO_RETURN
    draw_text(image, text, (9, 17), (255, 255, 255) if light else _INK, 0.46)
    return image


def _goal(image: Image, origin: np.ndarray, goal: np.ndarray) -> None:
    """A star at the goal, or at the panel's edge an arrow towards it."""
    height, width = image.shape[:2]
    low, high = np.array([14.0, 14.0]), np.array([width - 14.0, height - 14.0])
    if ((goal >= low) & (goal <= high)).all():
        _star(image, goal)
        return
    way = goal - origin
    room = np.where(way > 0, high - origin, origin - low) / np.maximum(np.abs(way), 1e-9)
    tip = origin + way * min(float(room.min()), 1.0)
    along = way / max(float(np.linalg.norm(way)), 1e-9)
    across = np.array([-along[1], along[0]])
    head = np.stack([tip + 7 * along, tip - 8 * along + 8 * across, tip - 8 * along - 8 * across])
    cv2.fillPoly(image, [np.round(head * 2**_FRACTION).astype(np.int32)], _MAGENTA, cv2.LINE_AA, _FRACTION)


def _robot(image: Image, place: np.ndarray) -> None:
    triangle = place + np.array([[0, -11], [7, 7], [0, 3], [-7, 7]])
    cv2.fillPoly(image, [np.round(triangle * 2**_FRACTION).astype(np.int32)], _INK, cv2.LINE_AA, _FRACTION)


def _star(image: Image, centre: np.ndarray) -> None:
    if not (np.abs(centre) < 1e4).all():
        return
    turn = -np.pi / 2 + np.arange(10) * np.pi / 5
    radius = np.where(np.arange(10) % 2 == 0, 11.0, 4.6)
    for grow, colour in ((1.3, (255, 255, 255)), (1.0, _MAGENTA)):
        corners = centre + grow * radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        cv2.fillPoly(image, [np.round(corners * 2**_FRACTION).astype(np.int32)], colour, cv2.LINE_AA, _FRACTION)


def _polyline(image: Image, points: np.ndarray, colour: Sequence[int], thickness: int) -> None:
    fixed = np.round(np.clip(points, -1e4, 1e4) * 2**_FRACTION).astype(np.int32)
    cv2.polylines(image, [fixed], False, tuple(colour), thickness, cv2.LINE_AA, _FRACTION)


def _fixed(point: np.ndarray) -> tuple[int, int]:
    return round(float(point[0]) * 2**_FRACTION), round(float(point[1]) * 2**_FRACTION)
