"""The coarse map of routes. Oracle: obstacles of known place in the world, which a robot has passed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.memory import (
    MapMemoryParameters,
    RouteMemoryParameters,
    empty_memory,
    empty_route_memory,
    route_grid,
    update_memory,
    update_route_memory,
)
from iwalker_jax.perception import DEFAULT_GRID, FrameCells

WINDOW = MapMemoryParameters(resolution=DEFAULT_GRID.resolution, cells=80)  # 4 m
ROUTES = RouteMemoryParameters(cells=60, rim=0.4)  # 12 m
POST = np.array([1.1, 0.9])
CENTRES = np.asarray(DEFAULT_GRID.centres())


@jax.jit
def passed(memory, cells, base):
    """Both maps after a frame in which a post in the world was seen as far as the frame reaches."""
    world = CENTRES + base[:2]
    post = jnp.sum((world - POST) ** 2, axis=-1) < 0.15**2
    cells = update_memory(WINDOW, cells, base, FrameCells(post, ~post, ~post))
    return *update_route_memory(ROUTES, WINDOW, memory, cells), cells


def walked(distance: float):
    """The coarse map of a robot that walked so far [m] along x past the post."""
    cells = empty_memory(WINDOW, jnp.zeros(2))
    memory = empty_route_memory(ROUTES, cells)
    for x in np.arange(0.0, distance + 0.01, 0.25):
        for _ in range(3):
            memory, esdf, cells = passed(memory, cells, jnp.asarray([x, 0.0, 0.0]))
    return memory, esdf


def places(memory) -> np.ndarray:
    """World positions [m] of the coarse cells."""
    grid = route_grid(ROUTES, WINDOW)
    return np.asarray(grid.centres()) + np.asarray(memory.middle) * grid.resolution


def test_what_left_the_window_stays_in_its_place():
    """Oracle: the distance to the post in closed form, within a coarse cell, from where the window has moved on."""
    memory, esdf = walked(4.0)
    at = places(memory)
    assert np.asarray(esdf).min() > 0.5  # the window of 4 m has lost sight of the post
    distance = np.linalg.norm(at - POST, axis=-1) - 0.15
    near = (distance < 0.5) & (np.asarray(memory.unseen) < 0.5)
    assert near.sum() > 12
    np.testing.assert_allclose(np.asarray(memory.clearance)[near], distance[near], atol=0.12)
    assert np.all(np.asarray(memory.room)[near] >= np.asarray(memory.clearance)[near] - 1e-6)
    untouched = np.abs(at - [4.0, 0.0]).max(axis=-1) > 5.7
    assert np.all(np.asarray(memory.unseen)[untouched & (at[..., 0] > 4.0)] == 1)


def test_the_rim_of_the_window_is_not_written():
    """Oracle: by construction; after one frame nothing is known beyond the window less its rim."""
    cells = empty_memory(WINDOW, jnp.zeros(2))
    memory, _, _ = passed(empty_route_memory(ROUTES, cells), cells, jnp.zeros(3))
    known = np.asarray(memory.unseen) < 1
    reach = np.abs(places(memory)).max(axis=-1)
    assert known.any() and reach[known].max() < 2.0 - ROUTES.rim
    assert np.all(np.asarray(memory.clearance)[~known & (reach > 2.0 - ROUTES.rim)] == 10.0)


@pytest.mark.parametrize("turned", [False, True])
def test_the_room_of_a_gap_is_half_its_width_whether_its_middle_is_a_cell_or_a_border(turned):
    """Oracle: the number of its free cells; beside a single wall, the best cell of the distance field."""
    window, routes = MapMemoryParameters(), RouteMemoryParameters(cells=80, rim=0.0)
    cells = empty_memory(window, jnp.zeros(2))

    @jax.jit
    def room_and_field(wall):
        seen = cells._replace(evidence=jnp.where(wall.T if turned else wall, 4.0, -4.0))
        memory, esdf = update_route_memory(routes, window, empty_route_memory(routes, cells), seen)
        return (memory.room.T, esdf.T) if turned else (memory.room, esdf)

    row, column = np.indices((window.cells, window.cells))
    thick = (row >= 192) & (row < 204)
    for count in range(12, 22):
        room, _ = room_and_field(jnp.asarray(thick & ((column < 161) | (column >= 161 + count))))
        np.testing.assert_allclose(room[49].max(), count * window.resolution / 2, atol=1e-6)
    room, field = room_and_field(jnp.asarray(thick))
    np.testing.assert_allclose(room[:48], np.asarray(field).reshape(80, 4, 80, 4).max(axis=(1, 3))[:48], atol=1e-6)


def test_a_map_smaller_than_the_window_holds_its_middle():
    """Oracle: the larger map's cells about the same middle."""
    small = RouteMemoryParameters(cells=10, rim=0.0)
    cells = empty_memory(WINDOW, jnp.zeros(2))
    large, _, cells = passed(empty_route_memory(ROUTES, cells), cells, jnp.zeros(3))
    found, _ = update_route_memory(small, WINDOW, empty_route_memory(small, cells), cells)
    np.testing.assert_allclose(found.clearance, large.clearance[25:35, 25:35], rtol=1e-6)


def test_a_robot_that_believes_to_have_jumped_starts_afresh():
    memory, _ = walked(0.5)
    cells = empty_memory(WINDOW, jnp.asarray([3.0, 0.0]))
    jumped, _ = update_route_memory(ROUTES, WINDOW, memory, cells)
    assert np.all(np.asarray(jumped.unseen) == 1)


def test_useless_parameters_are_refused():
    for wrong in ({"cells": 81}, {"cells": 0}, {"rim": -0.1}):
        with pytest.raises(InputError, match="RouteMemoryParameters"):
            RouteMemoryParameters(**wrong)
