"""The picture of one plan: pixels of the floor by back-projection, what hides them by hand, colours in their places."""

import cv2
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.frames.plan_picture import draw_plan, seen_pixels
from iwalker_jax.geometry import Side
from iwalker_jax.perception.camera import CameraMount, Intrinsics, backproject
from iwalker_jax.planning.planner import Plan

CAMERA, MOUNT = Intrinsics(), CameraMount()


def bare_floor() -> np.ndarray:
    """z-depth [m] of a bare floor and nothing above the horizon, by the mount's height and pitch alone."""
    down = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
    slope = np.cos(MOUNT.pitch) * down + np.sin(MOUNT.pitch)
    depth = np.where(slope > 0.06, MOUNT.height / np.maximum(slope, 0.06), 0.0)
    return np.repeat(depth[:, None], CAMERA.width, axis=1).astype(np.float32)


def straight_plan(first: Side = Side.LEFT) -> Plan:
    """A path straight ahead with ten footsteps beside it."""
    x = np.linspace(0.0, 3.0, 100)
    path = np.stack([x, np.zeros(100)], axis=1)
    sign = np.where((first + np.arange(10)) % 2 == Side.LEFT, 1.0, -1.0)
    footsteps = np.stack([0.4 + 0.2 * np.arange(10), 0.1 * sign], axis=1)
    return Plan(path, path[24::25], np.zeros(()), footsteps, np.int32(first))  # type: ignore[arg-type]


def drawn(tmp_path, depth: np.ndarray, plan: Plan, **options) -> np.ndarray:
    """The picture's colours, (rows, columns, blue green red)."""
    draw_plan(depth, plan, tmp_path / "new" / "plan.png", **options)
    return cv2.imread(str(tmp_path / "new" / "plan.png")).astype(int)


def share_of(image: np.ndarray, red: int, green: int, blue: int) -> tuple[float, np.ndarray]:
    """Share of pixels near a colour, and their columns."""
    near = (np.abs(image - (blue, green, red)) < 25).all(axis=-1)
    return float(near.mean()), np.nonzero(near)[1]


def test_pixels_of_the_floor_are_those_that_back_project_to_it():
    depth = bare_floor()
    points = np.asarray(backproject(depth, CAMERA, MOUNT.as_array()))
    rows, columns = np.array([40, 60, 80, 60]), np.array([80, 30, 80, 140])
    pixels, seen = seen_pixels(points[rows, columns][:, None, :2], depth, MOUNT, CAMERA)
    np.testing.assert_allclose(pixels[:, 0], np.stack([columns, rows], axis=1), atol=0.02)
    assert seen.all()


def test_what_lies_behind_an_obstacle_or_out_of_view_is_not_seen():
    wall = np.minimum(np.where(bare_floor() > 0, bare_floor(), 10.0), 1.0)
    ahead = np.array([[0.7, 0.0], [1.5, 0.0], [3.0, 0.0], [-1.0, 0.0], [0.7, 3.0]])[:, None]
    np.testing.assert_array_equal(seen_pixels(ahead, wall, MOUNT, CAMERA)[1], [True, False, False, False, False])
    np.testing.assert_array_equal(seen_pixels(ahead, bare_floor(), MOUNT, CAMERA)[1], [True, True, True, False, False])


def test_path_feet_and_goal_are_drawn_in_their_colours(tmp_path):
    image = drawn(tmp_path, bare_floor(), straight_plan(), goal=(2.5, 0.8))
    assert image.shape[1] > 800
    for colour in ((232, 53, 43), (31, 119, 180), (255, 127, 14), (255, 0, 255)):
        assert share_of(image, *colour)[0] > 1e-4, colour
    half = image[:, : image.shape[1] // 2]
    left, right = share_of(half, 31, 119, 180)[1], share_of(half, 255, 127, 14)[1]
    assert np.median(left) < np.median(right)
    without = drawn(tmp_path, bare_floor(), straight_plan())
    assert share_of(without, 255, 0, 255)[0] == 0.0


def test_the_other_foot_first_swaps_the_colours_places(tmp_path):
    plan = straight_plan(Side.RIGHT)
    image = drawn(tmp_path, bare_floor(), plan)
    half = image[:, : image.shape[1] // 2]
    assert np.median(share_of(half, 31, 119, 180)[1]) < np.median(share_of(half, 255, 127, 14)[1])
    # Footsteps in the same places, called by the other foot's name.
    image = drawn(tmp_path, bare_floor(), plan._replace(first_swing=np.int32(Side.LEFT)))
    half = image[:, : image.shape[1] // 2]
    assert np.median(share_of(half, 31, 119, 180)[1]) > np.median(share_of(half, 255, 127, 14)[1])


def test_hidden_paths_are_left_out_of_the_camera_view(tmp_path):
    wall = np.full((90, 160), 0.5, np.float32)
    image = drawn(tmp_path, wall, straight_plan())
    assert share_of(image[:, : image.shape[1] // 2], 232, 53, 43)[0] < 1e-3
    assert share_of(image[:, image.shape[1] // 2 :], 232, 53, 43)[0] > 1e-4


@pytest.mark.parametrize("goal", [(30.0, -4.0), (-2.0, 0.0), (0.0, 0.0)])
def test_goals_anywhere_and_empty_images_do(tmp_path, goal):
    assert drawn(tmp_path, np.zeros((90, 160), np.float32), straight_plan(), goal=goal).std() > 5


def test_batches_and_other_sizes_are_refused(tmp_path):
    plan = straight_plan()
    batch = Plan(*(np.asarray(leaf)[None] for leaf in plan))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="draw one plan at a time"):
        draw_plan(bare_floor(), batch, tmp_path / "plan.png")
    with pytest.raises(InputError, match="give the intrinsics of this resolution"):
        draw_plan(bare_floor()[:80], plan, tmp_path / "plan.png")
    with pytest.raises(InputError, match="floating-point metres"):
        draw_plan((1000 * bare_floor()).astype(np.uint16), plan, tmp_path / "plan.png")
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        draw_plan(bare_floor(), plan, tmp_path / "file" / "plan.png")
