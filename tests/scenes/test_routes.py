"""Ground-truth routes: free cells, lengths around walls and beside them, and what is cut off."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from iwalker_jax.errors import InputError
from iwalker_jax.perception.cost_to_go import UNREACHABLE
from iwalker_jax.scenes.routes import (
    RouteParameters,
    cost_at,
    free_cells,
    route_map,
    shortest_distance,
    straight_line_clearance,
)
from iwalker_jax.scenes.scene import Scene

ORIGIN = np.array([-2.0, 1.0])
EXTENT = np.array([8.0, 6.0])
# A wall across x = 2 that leaves y > 5 open, and a closed cupboard in a corner.
WALLS = [
    (2.0, 2.5, 0.1, 2.5),
    (-1.0, 2.7, 1.0, 0.1),
    (-0.1, 1.9, 0.1, 0.9),
    (-1.9, 1.9, 0.1, 0.9),
    (-1.0, 1.1, 1.0, 0.1),
]
GOAL = np.array([5.05, 2.05])
RADIUS = RouteParameters().inflated_radius


@pytest.fixture(scope="module")
def scene():
    boxes = np.array([[x, y, 0.5, hx, hy, 0.5, 0.0] for x, y, hx, hy in WALLS])
    bounds = (*ORIGIN, *(ORIGIN + EXTENT))
    return Scene("walled", "test", boxes, np.empty((0, 5)), bounds).arrays()


@pytest.fixture(scope="module")
def shortest(scene):
    return jax.jit(shortest_distance)(scene, jnp.asarray(GOAL, jnp.float32))


@pytest.fixture(scope="module")
def comfortable(scene):
    return jax.jit(route_map)(scene, jnp.asarray(GOAL, jnp.float32))


def clearance(points: np.ndarray) -> np.ndarray:
    """Distance [m] to the walls in plan view, zero inside, written apart from the library."""
    distance = np.full(points.shape[:-1], np.inf)
    for x, y, hx, hy in WALLS:
        outside = np.maximum(np.abs(points - (x, y)) - (hx, hy), 0.0)
        distance = np.minimum(distance, np.linalg.norm(outside, axis=-1))
    return distance


def centres() -> np.ndarray:
    rows, columns = np.meshgrid(np.arange(160), np.arange(160), indexing="ij")
    return ORIGIN + (np.stack([rows, columns], axis=-1) + 0.5) * 0.1


def eight_connected(free: np.ndarray, goal: tuple[int, int]) -> np.ndarray:
    """SciPy's Dijkstra on the king's-move graph without corner cutting: an upper bound of the true length."""
    rows, columns = free.shape
    number = np.arange(free.size).reshape(free.shape)
    heads, tails, lengths = [], [], []
    for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
        i, j = np.mgrid[0 : rows - a, max(0, -b) : columns - max(0, b)]
        open_edge = free[i, j] & free[i + a, j + b] & free[i + a, j] & free[i, j + b]
        heads.append(number[i, j][open_edge])
        tails.append(number[i + a, j + b][open_edge])
        lengths.append(np.full(open_edge.sum(), 0.1 * math.hypot(a, b)))
    graph = coo_matrix((np.concatenate(lengths), (np.concatenate(heads), np.concatenate(tails))), (free.size,) * 2)
    return dijkstra(graph.tocsr(), directed=False, indices=number[goal]).reshape(free.shape)


def test_free_cells_are_where_the_footprint_fits(scene):
    """Oracle: distances to the walls in NumPy; cells outside the bounds are never free."""
    points = centres()
    inside = ((points > ORIGIN) & (points < ORIGIN + EXTENT)).all(axis=-1)
    distance = clearance(points)
    sure = np.abs(distance - RADIUS) > 1e-4
    np.testing.assert_array_equal(np.asarray(free_cells(scene))[sure], (inside & (distance > RADIUS))[sure])


def test_lengths_lie_between_euclid_and_king_moves(scene, shortest):
    """Oracle: SciPy's Dijkstra on the eight-connected graph from above, the geodesic from below, same reachability."""
    free = np.asarray(free_cells(scene))
    goal = tuple(np.floor((GOAL - ORIGIN) / 0.1).astype(int))
    upper = eight_connected(free, goal)
    cost = np.asarray(shortest.cost)
    reachable = np.isfinite(upper) & free
    np.testing.assert_array_equal(cost < UNREACHABLE, reachable)
    assert (cost[reachable] <= upper[reachable] + 1e-3).all()
    straight = np.linalg.norm(centres() - GOAL, axis=-1)
    assert (cost[reachable] >= straight[reachable] - 0.15).all()
    open_side = reachable & (centres()[..., 0] > 2.4)
    assert (cost[open_side] <= 1.03 * straight[open_side] + 0.15).all()


def test_around_the_wall_the_length_is_the_taut_string(shortest):
    """Oracle: the geodesic around the wall's end, grown by the footprint: two tangents and an arc."""
    start = np.array([0.0, 4.0])
    corners = np.array([[1.9, 5.0 + RADIUS], [2.1, 5.0 + RADIUS]])
    taut = (
        np.linalg.norm(start - corners[0]) + np.linalg.norm(corners[1] - corners[0]) + np.linalg.norm(corners[1] - GOAL)
    )
    length = float(cost_at(shortest, jnp.asarray(start, jnp.float32)))
    assert taut - 0.1 < length < 1.03 * taut + 0.2
    assert length > 1.2 * np.linalg.norm(start - GOAL)


def test_comfort_only_adds_cost(shortest, comfortable):
    """Property: a comfortable route costs at least its length and stays reachable wherever the short one is."""
    short, comfort = np.asarray(shortest.cost), np.asarray(comfortable.cost)
    np.testing.assert_array_equal(short < UNREACHABLE, comfort < UNREACHABLE)
    reachable = short < UNREACHABLE
    assert (comfort[reachable] >= short[reachable] - 1e-3).all()
    assert (comfort[reachable] > short[reachable] + 0.1).any()


def test_cost_at_points_beside_inside_and_outside(shortest):
    """Oracle: Euclid in the open; a closed cupboard, a wall's inside and the far outside are unreachable."""
    points = np.array([[4.0, 3.0], [-1.0, 1.9], [2.0, 1.5], [-30.0, 40.0], [4.03, 3.04]])
    cost = np.asarray(cost_at(shortest, jnp.asarray(points, jnp.float32)))
    for index in (0, 4):
        straight = np.linalg.norm(points[index] - GOAL)
        assert straight - 0.1 < cost[index] < 1.03 * straight + 0.2
    np.testing.assert_array_equal(cost[1:4], UNREACHABLE)


def test_straight_line_clearance_equals_dense_sampling(scene):
    """Oracle: ten thousand samples in NumPy; a line through a wall has none."""
    clear = float(straight_line_clearance(scene, jnp.asarray([3.0, 1.5]), jnp.asarray([5.5, 6.0]), samples=256))
    line = np.array([3.0, 1.5]) + np.linspace(0, 1, 10_000)[:, None] * np.array([2.5, 4.5])
    assert clear == pytest.approx(clearance(line).min(), abs=2e-3)
    assert float(straight_line_clearance(scene, jnp.asarray([0.0, 4.0]), jnp.asarray(GOAL))) < 0


@pytest.mark.parametrize("changes", [{"inflated_radius": 0.5}, {"inflated_radius": 0.0}, {"discomfort": -1.0}])
def test_impossible_rules_are_refused(changes):
    with pytest.raises(InputError, match="RouteParameters"):
        RouteParameters(**changes)
