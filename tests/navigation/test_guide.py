"""Routes on the remembered map. Oracle: the width of a gap and that of the body with its sway."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.navigation.guide import GuidanceParameters, route_costs, route_grid
from iwalker_jax.perception.cost_to_go import UNREACHABLE
from iwalker_jax.perception.distance_field import signed_distance_field

PARAMETERS = GuidanceParameters()
GRID, COARSE = PARAMETERS.memory.grid, route_grid(PARAMETERS.memory.grid)
CENTRES = np.asarray(GRID.centres())


@jax.jit
def cost_of_start(occupied, start, goal):
    """Cheapest route from a place [m] to a goal [m] on a map."""
    esdf = signed_distance_field(occupied, PARAMETERS.memory.resolution)
    to_go = route_costs(PARAMETERS, esdf, jnp.zeros(COARSE.shape), start, goal)
    cell = jnp.round(COARSE.cell_coordinates(start)).astype(int)
    return to_go[cell[0], cell[1]]


@pytest.mark.parametrize("width", [0.25, 0.30, 0.35, 0.45, 0.60])
def test_routes_lead_through_gaps_that_the_body_fits_and_no_others(width):
    fits = width > 2 * PARAMETERS.required_clearance
    for angle in np.deg2rad([0.0, 17.0, 45.0]):
        for offset in (0.0, 0.01, 0.04):
            along, across = (
                (CENTRES - offset) @ [np.cos(angle), np.sin(angle)],
                CENTRES @ [-np.sin(angle), np.cos(angle)],
            )
            wall = (np.abs(along) < 0.06) & (np.abs(across) > width / 2)
            ahead = np.array([np.cos(angle), np.sin(angle)], np.float32)
            cost = cost_of_start(jnp.asarray(wall), -1.5 * ahead, 1.5 * ahead)
            assert (float(cost) < UNREACHABLE) == fits, (np.rad2deg(angle), offset)


def test_a_gap_that_the_robot_has_walked_up_to_need_only_fit_the_body():
    """Oracle: the gap's clearance in closed form, 18.25 cm at the cells' centres, from the wall and from afar."""
    along, across = np.moveaxis(CENTRES, -1, 0)
    esdf = jnp.asarray(np.where(np.abs(along) < 0.16, 0.195 - np.abs(across), 1.0), jnp.float32)
    for start, opens in ((-0.1, True), (-0.6, False)):
        place = jnp.asarray([start, 0.0])
        to_go = route_costs(PARAMETERS, esdf, jnp.zeros(COARSE.shape), place, jnp.asarray([1.5, 0.0]))
        cell = jnp.round(COARSE.cell_coordinates(place)).astype(int)
        assert (float(to_go[cell[0], cell[1]]) < UNREACHABLE) == opens


def test_a_lane_that_narrows_slowly_to_less_than_the_body_is_no_way():
    """Oracle: by construction; 0.2 m wide in the middle, 1 m at both ends."""
    lane = np.abs(CENTRES[..., 1]) > 0.1 + 0.4 * np.minimum(np.abs(CENTRES[..., 0]), 1.0)
    cost = cost_of_start(jnp.asarray(lane), jnp.asarray([-2.0, 0.0]), jnp.asarray([2.0, 0.0]))
    assert float(cost) == UNREACHABLE
