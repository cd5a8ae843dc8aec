"""Scenes: validation, padding, and the plan-view ground truth against brute force."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.grid_distance import occupancy
from iwalker_jax.scenes.scene import (
    LARGEST,
    SMALL,
    Scene,
    obstacle_distance,
    stack_scenes,
)

BOXES = np.array([[2.0, 1.0, 0.5, 0.6, 0.3, 0.5, 0.5], [4.0, 3.0, 0.4, 0.2, 0.9, 0.4, -1.2]])
CYLINDERS = np.array([[1.0, 3.5, 0.5, 0.4, 0.5]])
BOUNDS = (0.0, 0.0, 6.0, 5.0)


def make_scene(boxes: np.ndarray = BOXES, cylinders: np.ndarray = CYLINDERS, **changes) -> Scene:
    return Scene(**{"name": "t", "family": "t", "boxes": boxes, "cylinders": cylinders, "bounds": BOUNDS, **changes})


def boundary_points(scene: Scene) -> np.ndarray:
    """Dense points on the outline of every footprint."""
    along = np.linspace(-1, 1, 4001)
    outlines = []
    for x, y, _, hx, hy, _, yaw in scene.boxes:
        sides = [np.stack([along * hx, np.full_like(along, s * hy)], 1) for s in (-1, 1)]
        sides += [np.stack([np.full_like(along, s * hx), along * hy], 1) for s in (-1, 1)]
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        outlines.append(np.concatenate(sides) @ turn.T + (x, y))
    for x, y, _, radius, _ in scene.cylinders:
        angle = along * math.pi
        outlines.append(np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], 1))
    return np.concatenate(outlines)


def test_distance_equals_brute_force_over_the_outlines(x64):
    """Oracle: the nearest of thousands of points on each outline (disjoint obstacles, so also exact inside)."""
    scene = make_scene()
    points = np.random.default_rng(0).uniform((-1, -1), (7, 6), (400, 2))
    outline = boundary_points(scene)
    nearest = np.sqrt(((points[:, None] - outline) ** 2).sum(-1)).min(axis=1)
    distance = np.asarray(obstacle_distance(scene.arrays(), jnp.asarray(points)))
    np.testing.assert_allclose(np.abs(distance), nearest, atol=1e-3)
    local = points - BOXES[0, :2]
    in_first = (abs(local @ (math.cos(0.5), math.sin(0.5))) < 0.6) & (
        abs(local @ (-math.sin(0.5), math.cos(0.5))) < 0.3
    )
    assert in_first.any() and (distance[in_first] < 0).all()
    assert (distance < 0).mean() < 0.2


def test_only_geoms_in_the_height_band_count():
    """Oracle: by construction, a lintel and a doormat are no obstacles, a book on the floor and a table top are."""
    point = jnp.asarray([[0.0, 0.0]])
    bands = ((2.0, 2.5, False), (0.0, 0.02, False), (0.0, 0.04, True), (0.68, 0.72, True), (0.0, 3.0, True))
    for z_low, z_high, blocks in bands:
        box = np.array([[0.0, 0.0, (z_low + z_high) / 2, 1.0, 1.0, (z_high - z_low) / 2, 0.0]])
        cylinder = np.array([[0.0, 0.0, (z_low + z_high) / 2, 1.0, (z_high - z_low) / 2]])
        for scene in (make_scene(box, np.empty((0, 5))), make_scene(np.empty((0, 7)), cylinder)):
            assert (float(obstacle_distance(scene.arrays(), point)[0]) < 0) == blocks


def test_distance_gradient_equals_finite_differences(x64):
    """Oracle: central differences, away from the medial axis; finite even at centres and corners."""
    scene = make_scene().arrays()
    gradient = jax.vmap(jax.grad(lambda p: obstacle_distance(scene, p)))
    points = jnp.asarray([[0.3, 0.4], [2.1, 1.1], [3.4, 2.0], [1.1, 3.2], [5.5, 4.5]])
    step = 1e-6
    numeric = jnp.stack(
        [
            (obstacle_distance(scene, points.at[:, k].add(step)) - obstacle_distance(scene, points.at[:, k].add(-step)))
            / (2 * step)
            for k in range(2)
        ],
        axis=-1,
    )
    np.testing.assert_allclose(gradient(points), numeric, rtol=1e-5, atol=1e-7)
    assert np.isfinite(gradient(jnp.asarray([[2.0, 1.0], [1.0, 3.5], [4.0, 3.0]]))).all()


def test_occupancy_marks_inflated_obstacles_and_everything_outside():
    """Oracle: loop over cells in NumPy."""
    scene = make_scene().arrays()
    occupied = np.asarray(occupancy(scene, jnp.asarray([-1.0, -1.0]), 0.25, (32, 28), 0.2))
    for i in range(0, 32, 3):
        for j in range(0, 28, 3):
            x, y = -1 + (i + 0.5) * 0.25, -1 + (j + 0.5) * 0.25
            outside = not (0 <= x <= 6 and 0 <= y <= 5)
            near = float(obstacle_distance(scene, jnp.asarray([x, y]))) <= 0.2
            assert occupied[i, j] == (outside or near)


def test_padding_is_out_of_reach_and_scenes_stack():
    """Oracle: the same scene with and without its rows; capacity decides the shapes."""
    empty = make_scene(np.empty((0, 7)), np.empty((0, 5)))
    assert float(obstacle_distance(empty.arrays(), jnp.asarray([0.0, 0.0]))) > 100
    stacked = stack_scenes([make_scene(), empty])
    assert stacked.boxes.shape == (2, SMALL.boxes, 7) and stacked.cylinders.shape == (2, SMALL.cylinders, 5)
    points = jnp.asarray([[1.0, 1.0], [3.0, 2.0]])
    both = jax.vmap(obstacle_distance, in_axes=(0, None))(stacked, points)
    np.testing.assert_allclose(both[0], obstacle_distance(make_scene().arrays(), points), rtol=1e-6)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"boxes": np.zeros((2, 6))}, "shape"),
        ({"cylinders": np.zeros((2, 7))}, "shape"),
        ({"boxes": BOXES * np.nan}, "finite"),
        ({"boxes": -BOXES}, "positive"),
        ({"cylinders": CYLINDERS * 0}, "positive"),
        ({"bounds": (0.0, 0.0, 0.0, 1.0)}, "bounds"),
        ({"bounds": (0.0, 0.0, 52.0, 1.0)}, "bounds"),
        ({"ceiling": -1.0}, "ceiling"),
    ],
)
def test_bad_scenes_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        make_scene(**changes)


def test_too_many_geoms_are_refused():
    crowded = make_scene(boxes=np.tile(BOXES[:1], (LARGEST.boxes + 1, 1)))
    with pytest.raises(InputError, match="at most"):
        crowded.arrays()
    with pytest.raises(InputError, match="at least one"):
        stack_scenes([])


@pytest.mark.parametrize(
    "changes", [{"boxes": "rows"}, {"cylinders": [[1.0], [1.0, 2.0]]}, {"bounds": (0.0, 1.0)}, {"ceiling": "high"}]
)
def test_what_is_no_number_is_refused(changes, unchecked_types):
    with pytest.raises(InputError, match="Scene t: "):
        make_scene(**changes)
