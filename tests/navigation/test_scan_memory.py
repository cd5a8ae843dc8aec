"""Range scans written into the map memories and read as polar views, against scenes known by geometry."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    MapMemoryParameters,
    ViewPoint,
    WideMemoryParameters,
    add_scan,
    empty_memory,
    empty_wide_memory,
    map_cells,
    recorded_window,
    update_wide_memory,
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
WIDE = WideMemoryParameters()
COARSE = 0.2  # [m]


@jax.jit
def glance(memory, scene, pose):
    """The memory with one image taken at a pose."""
    depth = render_depth(scene, CAMERA, *world_camera_pose(pose, MOUNT))
    return add_scan(SCAN_MEMORY, memory, pose, range_scan(depth, MOUNT, CAMERA), MOUNT[3:5])


def scene_with(boxes):
    return Scene(
        "memory", "test", np.asarray(boxes, float).reshape(-1, 7), np.zeros((0, 5)), (-9.0, -9.0, 9.0, 9.0), 9.0
    ).arrays()


def seen(boxes, poses):
    """The memory of a robot that looked from some poses."""
    memory = empty_memory(SCAN_MEMORY, jnp.asarray(poses[0][:2]))
    for pose in jnp.asarray(poses):
        memory = glance(memory, scene_with(boxes), pose)
    return memory


update_wide = jax.jit(partial(update_wide_memory, WIDE, SCAN_MEMORY))
view_from = jax.jit(partial(view_map, VIEW, SCAN_MEMORY))


def remembered(memories, places):
    """The wide map of a robot that had these windows at these places."""
    wide = empty_wide_memory(WIDE, SCAN_MEMORY, memories[0])
    for memory, place in zip(memories, places, strict=True):
        wide = update_wide(wide, memory, jnp.asarray(place))
    return wide


def viewed(memory, base, goal, course=(0.0, 0.0)):
    wide = remembered([memory], [base[:2]])
    return view_from(memory, wide, ViewPoint(*(jnp.asarray(part) for part in (base, goal, course))))


def of_place(wide, layer, x, y):
    """A coarse cell's value."""
    index = np.floor(np.array([x, y]) / COARSE).astype(int) - np.asarray(wide.middle) + WIDE.cells // 2
    return float(np.asarray(getattr(wide, layer))[tuple(index)])


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
    memory = before
    for _ in range(8):
        memory = glance(memory, scene_with([[6.0, 0.0, 0.5, 0.1, 3.0, 0.5, 0.0]]), jnp.zeros(3))
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
        view, bearing = viewed(memory, [0.0, 0.0, heading], [0.0, 4.0], [1.0, 0.0])
        np.testing.assert_allclose(bearing, np.pi / 2, atol=1e-6)
        # The wall lies a quarter turn to the right of the goal.
        right = VIEW.bearings // 4
        first = (np.argmax(np.asarray(view.cells) == MapCell.OCCUPIED, axis=1) + 1) * VIEW.spacing
        np.testing.assert_allclose(first[right - 1 : right + 1], 2.0, atol=2 * SCAN_MEMORY.resolution)
        np.testing.assert_allclose(view.heading, [np.sin(heading), -np.cos(heading)], atol=1e-6)
        np.testing.assert_allclose(view.course, [0.0, -1.0], atol=1e-6)
        wide = (np.argmax(np.asarray(view.wide) == MapCell.OCCUPIED, axis=1) + 1) * VIEW.wide_spacing
        np.testing.assert_allclose(wide[right - 1 : right + 1], 2.0, atol=1.1 * COARSE)


def test_the_mirrored_world_is_the_mirrored_view():
    """Oracle: a scene and its mirror image, each seen by its own robot."""
    box = [1.6, 0.6, 0.5, 0.2, 0.3, 0.5, 0.0]
    other = [1.6, -0.6, 0.5, 0.2, 0.3, 0.5, 0.0]
    course = np.array([0.8, 0.6])
    one, _ = viewed(seen([box], [[0.0, 0.0, 0.0]] * 2), [0.0, 0.0, 0.2], [3.0, 0.0], course)
    two, _ = viewed(seen([other], [[0.0, 0.0, 0.0]] * 2), [0.0, 0.0, -0.2], [3.0, 0.0], course * [1.0, -1.0])
    # Cells lie to one side of their corners, so that a mirrored map may differ by a cell along its borders.
    assert np.mean(np.asarray(one.mirrored().cells) != np.asarray(two.cells)) < 0.02
    np.testing.assert_allclose(one.mirrored().goal, two.goal, atol=1e-6)


def test_the_wide_map_is_the_largest_of_the_windows_cells():
    """Oracle: NumPy, cell by cell, where the window lies; unseen beyond it."""
    memory = seen(WALL, [[0.0, 0.0, 0.0]] * 2)
    cells = np.asarray(map_cells(SCAN_MEMORY, memory))
    side = SCAN_MEMORY.cells // 4
    expected = np.zeros((WIDE.cells, WIDE.cells), int)
    rim = (WIDE.cells - side) // 2
    for i, j in np.ndindex(side, side):
        expected[rim + i, rim + j] = cells[4 * i : 4 * i + 4, 4 * j : 4 * j + 4].max()
    np.testing.assert_array_equal(remembered([memory], [[0.0, 0.0]]).cells, expected)


def test_what_has_left_the_window_is_remembered_by_the_wide_map():
    """Oracle: the wall's place, from 5 m away, where the window of 8 m no longer holds it."""
    first = seen(WALL, [[0.0, 0.0, 0.0]] * 2)
    memories, places = [first], [[0.0, 0.0]]
    for x in np.arange(0.5, 5.1, 0.5):
        memories.append(seen(WALL, [[-x, 0.0, np.pi]]))
        places.append([-x, 0.0])
    wide = remembered(memories, places)
    assert cell_at(first, 2.02, 0.03) == of_place(wide, "cells", 2.02, 0.03) == MapCell.OCCUPIED
    assert places[-1][0] + SCAN_MEMORY.cells // 2 * SCAN_MEMORY.resolution < 2.0


def test_places_count_how_often_the_robot_came_by_and_swaying_there_counts_nothing():
    """Oracle: a walk of 1 m, there and back, with visits every 0.25 m, and sway on the spot."""
    memory = seen(WALL, [[0.0, 0.0, 0.0]])
    there = [[x, 0.0] for x in np.arange(0.25, 1.1, 0.25)]
    wide = remembered([memory] * 4, there)
    # Places within the radius of a visit at 0.5 m: those at 0.25, 0.5 and 0.75 m.
    assert of_place(wide, "visits", 0.5, 0.0) == 3
    assert of_place(wide, "visits", 0.5, 0.7) == of_place(wide, "visits", -0.7, 0.0) == 0
    back = remembered([memory] * 7, there + there[-2::-1])
    assert of_place(back, "visits", 0.5, 0.0) == 6
    swaying = remembered([memory] * 24, there + [[1.0, 0.05 * (-1) ** k] for k in range(20)])
    np.testing.assert_array_equal(swaying.visits, wide.visits)
