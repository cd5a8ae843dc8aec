"""Routes on the remembered map. Oracle: the width of a gap and that of the body with its sway."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.navigation.guide import GuidanceParameters, Observation, guide, route_costs, start_guide
from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    RouteMemoryParameters,
    empty_memory,
    empty_route_memory,
    route_grid,
    update_route_memory,
    window_origin,
)
from iwalker_jax.perception import ROUTE_POINTS, CameraMount, Intrinsics, best_routes
from iwalker_jax.perception.cost_to_go import UNREACHABLE
from iwalker_jax.planning import MemoryIPath, MemoryIPathConfig
from iwalker_jax.training.pretrained import load_planner

# The coarse map is no wider than the window, so that a wall across the window has no ends.
PARAMETERS = GuidanceParameters(routes=RouteMemoryParameters(cells=80, rim=0.0))
GRID, COARSE = PARAMETERS.memory.grid, route_grid(PARAMETERS.routes, PARAMETERS.memory)
CENTRES = np.asarray(GRID.centres())
FAR_OFF = jnp.full((ROUTE_POINTS, 2), 99.0)


def seen(occupied):
    """The coarse map of a robot at the origin that has seen the window, its occupied cells and all others free."""
    cells = empty_memory(PARAMETERS.memory, jnp.zeros(2))
    cells = cells._replace(evidence=jnp.where(occupied, 4.0, -4.0))
    nothing = empty_route_memory(PARAMETERS.routes, cells)
    return update_route_memory(PARAMETERS.routes, PARAMETERS.memory, nothing, cells)[0]


def cost_at(to_go, place):
    """Cost-to-go in a place's [m] cell."""
    cell = jnp.round(COARSE.cell_coordinates(place)).astype(int)
    return to_go[cell[0], cell[1]]


@jax.jit
def cost_of_start(occupied, start, goal):
    """Cheapest route from a place [m] to a goal [m] on a map."""
    return cost_at(route_costs(PARAMETERS, seen(occupied), start, goal, FAR_OFF), start)


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
    """Oracle: the room in the gap, 18.25 cm by construction, between the body's 18 cm and the 19.5 cm of others."""
    along, across = np.moveaxis(np.asarray(COARSE.centres()), -1, 0)
    room = jnp.asarray(np.where(np.abs(along) > 0.16, 1.0, np.where(np.abs(across) < 0.1, 0.1825, 0.0)), jnp.float32)
    routes = seen(np.zeros(GRID.shape, bool))._replace(room=room, clearance=room)
    gap, far = jnp.zeros((ROUTE_POINTS, 2)), FAR_OFF
    # Walked up to, seen from afar, and seen from afar by a robot whose last route led through it.
    for start, kept, opens in ((-0.1, far, True), (-0.6, far, False), (-0.6, gap, True)):
        place = jnp.asarray([start, 0.0])
        to_go = route_costs(PARAMETERS, routes, place, jnp.asarray([1.5, 0.0]), kept)
        assert (float(cost_at(to_go, place)) < UNREACHABLE) == opens


def test_a_route_that_does_not_exist_is_not_kept():
    """What stands for it begins beyond the gap and leads back through it, where the body alone would fit. Oracle: the
    gap's 15 free cells of 2.5 cm, between the width of the body and what routes ask for."""
    parameters = dataclasses.replace(PARAMETERS, source="route")
    intrinsics = Intrinsics()
    planner = load_planner()[0]
    look = jax.jit(lambda memory, seen: guide(parameters, planner, intrinsics, memory, seen))
    base = jnp.asarray([-0.9, 0.0, 0.0])
    memory = start_guide(parameters, base[:2])
    along, across = np.moveaxis(CENTRES + np.asarray(window_origin(parameters.memory, memory.cells)), -1, 0)
    wall = jnp.asarray((np.abs(along) < 0.06) & (np.abs(across - 0.0125) > 0.18))
    memory = memory._replace(cells=memory.cells._replace(evidence=jnp.where(wall, 4.0, -4.0)))
    blind = jnp.zeros((intrinsics.height, intrinsics.width))
    observation = Observation(blind, CameraMount().as_array(), base, jnp.asarray([1.5, 0.0]))
    for _ in range(4):
        memory, way = look(memory, observation)
        assert not way.route_exists
        np.testing.assert_allclose(way.path, jnp.broadcast_to(base[:2], way.path.shape), atol=1e-6)


@pytest.mark.parametrize(("times", "goes_on"), [(11, True), (12, False)])
def test_who_has_come_by_too_often_has_no_way(times, goes_on):
    """Oracle: `most_visits`, up to which the network's view counts."""
    parameters = GuidanceParameters(source="memory", memory=SCAN_MEMORY)
    network = MemoryIPath(MemoryIPathConfig(), nnx.Rngs(0))
    intrinsics, planner, base = Intrinsics(), load_planner()[0], jnp.asarray([0.1, 0.2, 0.3])
    memory = start_guide(parameters, base[:2])
    memory = memory._replace(wide=memory.wide._replace(visits=jnp.full_like(memory.wide.visits, times)))
    blind = jnp.zeros((intrinsics.height, intrinsics.width))
    observation = Observation(blind, CameraMount().as_array(), base, jnp.asarray([2.5, 0.0]))
    _, way = jax.jit(lambda *args: guide(parameters, planner, intrinsics, *args, network))(memory, observation)
    assert bool(way.route_exists) == goes_on
    assert (float(jnp.abs(way.path - base[:2]).max()) > 0.5) == goes_on


def test_a_lane_that_narrows_slowly_to_less_than_the_body_is_no_way():
    """Oracle: by construction; 0.2 m wide in the middle, 1 m at both ends."""
    lane = np.abs(CENTRES[..., 1]) > 0.1 + 0.4 * np.minimum(np.abs(CENTRES[..., 0]), 1.0)
    cost = cost_of_start(jnp.asarray(lane), jnp.asarray([-2.0, 0.0]), jnp.asarray([2.0, 0.0]))
    assert float(cost) == UNREACHABLE


def test_a_goal_beyond_a_blocked_corner_of_the_map_has_a_route():
    """Oracle: by construction; what cuts off the corner nearest to the goal hides nothing, a ring hides all."""
    corner = np.abs(CENTRES.sum(-1) - 6.0) < 0.1
    goal = jnp.asarray([5.0, 5.0])
    assert 7.0 < float(cost_of_start(jnp.asarray(corner), jnp.zeros(2), goal)) < 1.7 * 5.0 * 2**0.5
    ring = np.abs(np.max(np.abs(CENTRES), axis=-1) - 3.0) < 0.1
    assert float(cost_of_start(jnp.asarray(ring), jnp.zeros(2), goal)) == UNREACHABLE


@pytest.mark.parametrize(("shift", "keeps"), [(0.1, True), (0.9, False)])
def test_a_route_is_kept_unless_another_is_much_cheaper(shift, keeps):
    """Oracle: by construction; around a wall's ends the right way is shorter, by little or by much."""
    along, across = np.moveaxis(CENTRES, -1, 0)
    wall = (np.abs(along - 1.0) < 0.1) & (np.abs(across - shift) < 1.3)
    goal, routes = jnp.asarray([2.0, 0.0]), seen(jnp.asarray(wall))

    def way(kept):
        to_go = route_costs(PARAMETERS, routes, jnp.zeros(2), goal, kept)
        return best_routes(to_go, routes.unseen, goal, jnp.zeros(2), COARSE).whole

    shorter = way(FAR_OFF)
    assert float(shorter[:, 1].min()) < shift - 1.3
    # What was taken as long as the wall seemed to reach as far to the right.
    before = jnp.where(jnp.arange(2) == 1, -shorter, shorter) + jnp.asarray([0.0, 2 * shift])
    before = before.at[0].set(0.0)
    after = way(before)
    assert (float(after[:, 1].max()) > shift + 1.3) == keeps
    np.testing.assert_allclose(way(after), after, atol=0.1)
