"""Training maps: batches equal single frames, and routes end where they should, around what is in the way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.cost_to_go import cost_to_go
from iwalker_jax.perception.seen_route import ROUTE_GRID, ROUTE_POINTS, best_routes
from iwalker_jax.perception.traversal import TraversalParameters
from iwalker_jax.training.maps import FrameMaps, frame_maps, prepare

RULES = TraversalParameters()


def test_prepare_equals_frame_maps_one_by_one(small_frames, small_data):
    """Oracle: the unbatched function, in single precision."""
    single = jax.jit(lambda depth, mount, goals: frame_maps(depth, mount, goals, Intrinsics(), RULES))
    for i in (0, 5, 7):
        maps = single(small_frames.depth_metres()[i], small_frames.mounts[i], small_frames.goals[i])
        names = {"esdf": "esdf", "unknown": "unknown", "to_go": "to_go", "route": "routes", "published": "published"}
        for name, stored in names.items():
            wanted = np.asarray(getattr(maps, name))
            assert np.isfinite(wanted).all()
            got = np.asarray(getattr(small_data, stored)[i], np.float32)
            np.testing.assert_allclose(got, wanted, rtol=2e-3, atol=2e-3, err_msg=name)
    np.testing.assert_array_equal(small_data.depth, small_frames.depth)
    np.testing.assert_array_equal(small_data.mounts, small_frames.mounts)
    np.testing.assert_array_equal(small_data.goals, small_frames.goals)


def test_a_partial_last_batch_changes_nothing(small_frames, small_data):
    """Oracle: the same frames prepared in one full batch; the display hears of every frame once."""
    heard = []
    parts = prepare(small_frames.select(np.arange(6)), RULES, batch=4, on_progress=heard.append)
    assert heard == [4, 6]
    for name, part, whole in zip(parts._fields, parts, small_data):
        assert part.shape == (6, *whole.shape[1:])
        assert part.dtype == whole.dtype
        np.testing.assert_allclose(
            np.asarray(part, np.float32), np.asarray(whole[:6], np.float32), rtol=1e-3, atol=1e-3, err_msg=name
        )


@jax.jit
def plan_route(cost, unknown, goal):
    return best_routes(cost_to_go(cost, goal, ROUTE_GRID).value.cost, unknown, goal).seen


CENTRES = np.asarray(ROUTE_GRID.centres())
OPEN = np.ones(ROUTE_GRID.shape, np.float32)
SEEN = np.zeros(ROUTE_GRID.shape, np.float32)


def route(cost, unknown, goal) -> np.ndarray:
    points = np.asarray(plan_route(jnp.asarray(cost), jnp.asarray(unknown), jnp.asarray(goal, jnp.float32)))
    assert points.shape == (ROUTE_POINTS, 2)
    assert np.isfinite(points).all()
    np.testing.assert_allclose(points[0], 0.0, atol=1e-6)
    return points


def length(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


@pytest.mark.parametrize("goal", [(4.0, 0.0), (3.1, -2.2), (0.5, 3.0), (-0.5, -0.3)])
def test_in_open_space_the_route_ends_at_the_goal(goal):
    """Oracle: the straight line; the graph's sixteen headings cost at most 2.8 %."""
    points = route(OPEN, SEEN, goal)
    np.testing.assert_allclose(points[-1], goal, atol=1e-5)
    straight = np.linalg.norm(goal)
    assert straight - 1e-4 <= length(points) < 1.028 * straight + 0.1
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.1)


def test_the_route_stops_where_sight_ends():
    """Property: from x = 2 m on nothing was seen, so the route ends just before.

    Shortest routes on the graph mix steps straight ahead and knight's steps, in any order; rounding chooses one.
    """
    points = route(OPEN, (CENTRES[..., 0] > 2.0).astype(np.float32), (4.0, 1.0))
    assert 1.6 < points[-1, 0] < 2.05
    assert -0.06 < points[-1, 1] < points[-1, 0] / 2 + 0.06


def test_the_route_does_not_resume_behind_an_unseen_strip():
    strip = ((CENTRES[..., 0] > 1.0) & (CENTRES[..., 0] < 1.6)).astype(np.float32)
    points = route(OPEN, strip, (4.0, 0.0))
    assert 0.7 < points[:, 0].max() < 1.1


def king_and_knight(cost: np.ndarray, source: tuple[int, int]) -> np.ndarray:
    """SciPy's Dijkstra over straight and diagonal moves, an edge costing its length times its ends' mean."""
    rows, columns = cost.shape
    number = np.arange(cost.size).reshape(cost.shape)
    heads, tails, weights = [], [], []
    for a, b in ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (2, -1), (1, 2), (1, -2)):
        i, j = np.mgrid[0 : rows - a, max(0, -b) : columns - max(0, b)]
        heads.append(number[i, j].ravel())
        tails.append(number[i + a, j + b].ravel())
        weights.append((0.05 * np.hypot(a, b) * (cost[i, j] + cost[i + a, j + b])).ravel())
    graph = coo_matrix((np.concatenate(weights), (np.concatenate(heads), np.concatenate(tails))), (cost.size,) * 2)
    return dijkstra(graph.tocsr(), directed=False, indices=number[source]).reshape(cost.shape)


def test_the_route_leads_around_an_obstacle_as_short_as_can_be():
    """Oracle: SciPy's Dijkstra for the cost of the same way; the route's own cost must match it."""
    wall = (np.abs(CENTRES[..., 0] - 1.5) < 0.25) & (CENTRES[..., 1] > -1.0) & (CENTRES[..., 1] < 3.0)
    cost = np.where(wall, 40.0, 1.0).astype(np.float32)
    goal = CENTRES[40, 42]
    points = route(cost, SEEN, goal)
    np.testing.assert_allclose(points[-1], goal, atol=1e-5)
    inside = (np.abs(points[:, 0] - 1.5) < 0.2) & (points[:, 1] > -0.9)
    assert not inside.any()
    assert points[:, 1].min() < -0.9
    start = tuple(np.argwhere(np.isclose(CENTRES, (0.05, 0.05), atol=1e-3).all(axis=-1))[0])
    shortest = king_and_knight(cost.astype(np.float64), start)[40, 42]
    corners = np.array([[0.0, 0.0], [1.25, -1.0], [1.75, -1.0], goal])
    taut = length(corners)
    assert taut < shortest < 1.06 * taut
    assert 0.95 * taut < length(points) < shortest + 0.15


def test_goals_at_the_feet_and_far_outside():
    """A goal at the robot gives a route of no length; one 100 m away ends at the map's edge in its direction."""
    assert length(route(OPEN, SEEN, (0.0, 0.0))) < 0.3
    points = route(OPEN, SEEN, (100.0, 0.0))
    assert points[-1, 0] > ROUTE_GRID.x_max - 0.2
    assert np.abs(points[:, 1]).max() < 0.3
    behind = route(OPEN, SEEN, (-100.0, 0.0))
    assert behind[-1, 0] < ROUTE_GRID.x_min + 0.2


def test_a_robot_that_sees_nothing_stays():
    assert length(route(OPEN, np.ones_like(SEEN), (3.0, 0.0))) < 1e-3


def test_mirrored_maps_mirror_back(small_data):
    """Property: an involution that moves a cell at +y to the cell at -y."""
    maps = FrameMaps(
        small_data.esdf[0], small_data.unknown[0], small_data.to_go[0], small_data.routes[0], small_data.published[0]
    )
    for once, twice in zip(maps, maps.mirrored().mirrored()):
        np.testing.assert_array_equal(once, twice)
    assert (np.asarray(maps.esdf) != np.asarray(maps.mirrored().esdf)).any()
