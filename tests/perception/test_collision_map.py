"""Occupancy and the published collision map against NumPy, OpenCV and scenes of known geometry."""

import cv2
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics, backproject
from iwalker_jax.perception.collision_map import (
    ObstacleParameters,
    occupancy_map,
    point_planes,
    published_collision_map,
)
from iwalker_jax.perception.depth_cleanup import clean_depth
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec
from tests.perception.box_scene import render

INTRINSICS = Intrinsics()
TILTED = CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4), forward=0.1, left=0.03)

occupancy = jax.jit(occupancy_map, static_argnames=("intrinsics", "grid", "obstacles"))


def test_point_planes_equal_backproject():
    depth = np.random.default_rng(0).uniform(0.0, 8.0, (90, 160)).astype(np.float32)
    planes = point_planes(jnp.asarray(depth), TILTED.as_array(), INTRINSICS)
    points = np.asarray(backproject(depth, INTRINSICS, TILTED.as_array()))
    np.testing.assert_allclose(np.stack(planes[:3], axis=-1), points, atol=1e-5)
    offset = np.linalg.norm(points[..., :2] - np.array([0.1, 0.03], np.float32), axis=-1)
    np.testing.assert_allclose(planes.ground_range, offset, atol=1e-5)


def test_published_map_equals_opencv():
    """Oracle: the recipe in NumPy with np.add.at, and cv2.GaussianBlur (7 x 7, sigma 1.4)."""
    boxes = [(3.03, 3.2, -1.03, 2.02, 0.0, 2.0), (0.54, 0.7, 0.23, 0.4, 0.0, 2.0), (2.04, 2.06, -0.7, -0.68, 0.0, 1.0)]
    depth = render(INTRINSICS, TILTED, boxes)
    points = np.asarray(backproject(depth, INTRINSICS, TILTED.as_array()), np.float64)
    kept = points[(depth > 0.8) & (np.abs(points[..., 2] - 0.62) < 0.2)]
    rows, columns = np.floor(kept[:, 0] / 0.1).astype(int), np.floor((kept[:, 1] + 5.0) / 0.1).astype(int)
    inside = (rows >= 0) & (rows < 100) & (columns >= 0) & (columns < 100)
    values = np.zeros((100, 100))
    np.add.at(values, (rows[inside], columns[inside]), 0.1)
    values[values < 0.15] = 0.0
    expected = cv2.GaussianBlur(np.minimum(values, 2.0), (7, 7), 1.4)
    ours = np.asarray(published_collision_map(jnp.asarray(depth), TILTED.as_array(), INTRINSICS))
    assert expected.max() > 0.5
    # A point within float32 rounding of a cell's edge may fall to either side: 0.1 of a few cells.
    assert np.mean(np.abs(ours - expected) > 1e-5) < 0.02
    assert np.abs(ours - expected).max() < 0.05


@pytest.mark.parametrize("mount", [CameraMount(), TILTED])
def test_a_bare_floor_holds_no_obstacle(mount):
    depth = render(INTRINSICS, mount, [])
    assert not np.asarray(occupancy(depth, mount.as_array(), INTRINSICS)).any()


def test_a_pitch_error_of_a_degree_raises_no_phantom_obstacle():
    depth = render(INTRINSICS, TILTED, [])
    wrong = TILTED.as_array().at[1].add(np.deg2rad(-1.0))
    assert not np.asarray(occupancy(depth, wrong, INTRINSICS)).any()


@pytest.mark.parametrize("mount", [CameraMount(), TILTED])
@pytest.mark.parametrize("distance", [1.0, 1.5, 2.0, 3.0])
@pytest.mark.parametrize("shift", [0.0, 0.025])
def test_a_thin_table_leg_remains(mount, distance, shift):
    """A leg of 3 cm x 3 cm, also on a cell border, occupies its own cell (or the neighbour within one cell)."""
    x, y = distance + shift, 0.1 + shift
    depth = render(INTRINSICS, mount, [(x, x + 0.03, y, y + 0.03, 0.0, 0.72)])
    occupied = np.asarray(occupancy(clean_depth(depth), mount.as_array(), INTRINSICS))
    centres = np.asarray(DEFAULT_GRID.centres())[occupied]
    assert len(centres) >= 1
    assert np.abs(centres - np.array([x, y + 0.015])).max() < 0.05


def test_noise_speckles_and_walked_under_boards_are_no_obstacles():
    """Ghost returns at 1 % of the pixels and a board at 0.8-1.0 m above the floor leave the floor free."""
    rng = np.random.default_rng(3)
    mount = CameraMount()
    depth = render(INTRINSICS, mount, [(2.0, 2.5, -2.0, 2.0, 0.8, 1.0)])
    ghosts = rng.random(depth.shape) < 0.01
    depth = np.where(ghosts, rng.uniform(0.3, 8.0, depth.shape), depth).astype(np.float32)
    assert np.asarray(occupancy(depth, mount.as_array(), INTRINSICS)).sum() < 5
    assert not np.asarray(occupancy(clean_depth(depth), mount.as_array(), INTRINSICS)).any()


def test_a_box_is_found_where_it_stands():
    """Oracle: the box's own faces; every visible front cell is occupied, none outside the box by more than a cell."""
    mount = CameraMount()
    depth = render(INTRINSICS, mount, [(2.0, 2.4, -0.5, 0.5, 0.0, 0.5)])
    occupied = np.asarray(occupancy(depth, mount.as_array(), INTRINSICS))
    centres = np.asarray(DEFAULT_GRID.centres())
    x, y = centres[..., 0], centres[..., 1]
    front = (np.abs(x - 2.025) < 0.01) & (np.abs(y) < 0.49)
    grown = (x > 1.95) & (x < 2.45) & (np.abs(y) < 0.55)
    assert front.sum() == 20 and occupied[front].all()
    assert not occupied[~grown].any()


def test_mirroring_the_world_mirrors_the_map():
    rng = np.random.default_rng(4)
    depth = rng.uniform(0.5, 6.0, (90, 160)).astype(np.float32)
    mount = CameraMount().as_array()
    grid = GridSpec(x_min=-0.811, y_min=-4.0)  # not a multiple of the pixels' positions: no point on a cell border
    plain = np.asarray(occupancy(depth, mount, INTRINSICS, grid))
    mirrored = np.asarray(occupancy(depth[:, ::-1], mount, INTRINSICS, grid))
    assert plain.any()
    assert np.mean(mirrored[:, ::-1] != plain) < 1e-3


@pytest.mark.parametrize(
    "bad",
    [
        {"min_height": 0.8},
        {"max_height": np.inf},
        {"tolerance_slope": -0.1},
        {"min_area": 0.0},
        {"min_points": 9},
    ],
)
def test_parameters_that_cannot_be_are_refused(bad):
    with pytest.raises(InputError):
        ObstacleParameters(**bad)
