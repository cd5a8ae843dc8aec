"""Range scans written into the map memory and read as a polar view, against scenes known by geometry."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    MapMemoryParameters,
    add_scan,
    empty_memory,
    map_cells,
    recorded_window,
    view_map,
    window_origin,
)
from iwalker_jax.perception import CameraMount, Intrinsics, range_scan
from iwalker_jax.planning import MapCell, MapViewParameters
from iwalker_jax.scenes import Scene, render_depth, world_camera_pose

CAMERA = Intrinsics(64, 36, 32.0, 32.0, 31.5, 17.5)
MOUNT = CameraMount().as_array()
WALL = np.array([[2.1, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0]])
VIEW = MapViewParameters()


def seen(boxes, poses):
    """The memory of a robot that looked from some poses."""
    scene = Scene(
        "memory", "test", np.asarray(boxes, float).reshape(-1, 7), np.zeros((0, 5)), (-9.0, -9.0, 9.0, 9.0), 9.0
    )
    memory = empty_memory(SCAN_MEMORY, jnp.asarray(poses[0][:2]))
    for pose in jnp.asarray(poses):
        depth = render_depth(scene.arrays(), CAMERA, *world_camera_pose(pose, MOUNT))
        memory = add_scan(SCAN_MEMORY, memory, pose, range_scan(depth, MOUNT, CAMERA), MOUNT[3:5])
    return memory


def cell_at(memory, x, y):
    index = np.floor(np.array([x, y]) / SCAN_MEMORY.resolution).astype(int)
    index = index - np.asarray(memory.middle) + SCAN_MEMORY.cells // 2
    return MapCell(int(map_cells(SCAN_MEMORY, memory)[tuple(index)]))


def test_the_wall_is_occupied_the_way_there_free_and_what_lies_behind_unseen():
    """Oracle: the scene."""
    memory = seen(WALL, [[0.0, 0.0, 0.0]] * 2)
    assert cell_at(memory, 2.02, 0.03) == MapCell.OCCUPIED
    assert cell_at(memory, 1.2, 0.03) == cell_at(memory, 1.7, 0.3) == MapCell.FREE
    assert cell_at(memory, 2.4, 0.03) == cell_at(memory, -1.0, 0.03) == MapCell.UNSEEN
    # Under the robot and between it and the first floor in view.
    assert cell_at(memory, 0.02, 0.03) == cell_at(memory, 0.3, 0.03) == MapCell.FREE


def test_what_has_left_the_view_is_remembered_beside_the_body():
    """Oracle: a wall that was seen, and then turned away from, with the body beside it."""
    memory = seen(WALL, [[1.0, 0.0, 0.0]] * 3 + [[1.8, 0.0, 2.0]] * 20)
    assert cell_at(memory, 2.02, 0.03) == MapCell.OCCUPIED


def test_an_obstacle_that_has_gone_is_forgotten():
    """Oracle: the same place seen to be free for a few frames."""
    before = seen(WALL, [[0.0, 0.0, 0.0]] * 3)
    far = [[6.0, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0]]
    scene = Scene("memory", "test", np.array(far), np.zeros((0, 5)), (-9.0, -9.0, 9.0, 9.0), 9.0)
    pose = jnp.zeros(3)
    depth = render_depth(scene.arrays(), CAMERA, *world_camera_pose(pose, MOUNT))
    memory = before
    for _ in range(8):
        memory = add_scan(SCAN_MEMORY, memory, pose, range_scan(depth, MOUNT, CAMERA), MOUNT[3:5])
    assert cell_at(memory, 2.02, 0.03) == MapCell.FREE


@pytest.mark.parametrize("window", [MapMemoryParameters(), SCAN_MEMORY], ids=["fine", "scans"])
def test_a_window_on_record_lies_where_the_memory_holds_it(window):
    """Oracle: the memory's own origin, for robots anywhere, in cells of either size."""
    for xy in np.random.default_rng(0).uniform(-5, 5, (50, 2)).astype(np.float32):
        memory = empty_memory(window, jnp.asarray(xy))
        corner, resolution = recorded_window(xy, window.cells)
        assert resolution == pytest.approx(window.resolution)
        half = window.cells // 2 * window.resolution
        np.testing.assert_allclose(corner + half, window_origin(window, memory), atol=1e-4)


def test_the_view_turns_with_the_goal_and_not_with_the_robot():
    """Oracle: the bearing at which the wall's nearest point lies, whatever the heading; the goal is at bearing zero."""
    memory = seen(WALL, [[0.0, 0.0, 0.0]] * 2)
    for heading in (0.0, 1.0, -2.5):
        view, bearing = view_map(VIEW, SCAN_MEMORY, memory, jnp.array([0.0, 0.0, heading]), jnp.array([0.0, 4.0]))
        np.testing.assert_allclose(bearing, np.pi / 2, atol=1e-6)
        # The wall lies a quarter turn to the right of the goal.
        right = VIEW.bearings // 4
        first = (np.argmax(np.asarray(view.cells) == MapCell.OCCUPIED, axis=1) + 1) * VIEW.spacing
        np.testing.assert_allclose(first[right - 1 : right + 1], 2.0, atol=2 * SCAN_MEMORY.resolution)
        np.testing.assert_allclose(view.goal[2:], [np.cos(heading - np.pi / 2), np.sin(heading - np.pi / 2)], atol=1e-6)


def test_the_mirrored_world_is_the_mirrored_view():
    """Oracle: a scene and its mirror image, each seen by its own robot."""
    box = [1.6, 0.6, 0.5, 0.2, 0.3, 0.5, 0.0]
    other = [1.6, -0.6, 0.5, 0.2, 0.3, 0.5, 0.0]
    goal = jnp.array([3.0, 0.0])
    one, _ = view_map(VIEW, SCAN_MEMORY, seen([box], [[0.0, 0.0, 0.0]] * 2), jnp.zeros(3), goal)
    two, _ = view_map(VIEW, SCAN_MEMORY, seen([other], [[0.0, 0.0, 0.0]] * 2), jnp.zeros(3), goal)
    # Cells lie to one side of their corners, so that a mirrored map may differ by a cell along its borders.
    assert np.mean(np.asarray(one.mirrored().cells) != np.asarray(two.cells)) < 0.02
    np.testing.assert_allclose(one.mirrored().goal, two.goal, atol=1e-6)
