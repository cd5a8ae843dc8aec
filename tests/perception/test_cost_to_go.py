"""Cost-to-go against SciPy's Dijkstra on the same graph, and routes that must stay off blocked cells."""

from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import Status
from iwalker_jax.perception.cost_to_go import UNREACHABLE, cost_to_go, descend, trusted_cost
from iwalker_jax.perception.grid import GridSpec
from tests.perception.route_costs import dijkstra_costs

GRID = GridSpec(x_min=0.0, y_min=-1.0, resolution=0.1, rows=30, columns=23)
SOLVE = jax.jit(cost_to_go, static_argnums=(2, 3))
DESCEND = jax.jit(descend, static_argnums=(1, 3))


def random_cost(seed, blocked, shape=GRID.shape):
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.5, 5.0, shape)
    cost[rng.random(shape) < blocked] = np.inf
    return cost.astype(np.float32)


def spiral_cost():
    """Walls that make the only route turn many times, in both directions."""
    cost = np.ones(GRID.shape, np.float32)
    for n, row in enumerate(range(2, 28, 3)):
        cost[row, :] = np.inf
        cost[row, 0 if n % 2 else -1] = 1.0
    cost[6, 5:20:4] = np.inf
    cost[7, 7:20:4] = np.inf
    return cost


def centre(cell):
    return jnp.asarray(GRID.centres()[cell])


def compare(cost, goal_cell, max_rounds=64):
    solution = SOLVE(jnp.asarray(cost), centre(goal_cell), GRID, max_rounds)
    expected = dijkstra_costs(cost.astype(float), goal_cell, GRID.resolution)
    expected = np.where(np.isfinite(expected), expected, UNREACHABLE)
    np.testing.assert_allclose(solution.value.cost, expected, rtol=1e-4, atol=1e-5)
    assert solution.status == Status.CONVERGED
    assert solution.residual == 0
    return solution


@pytest.mark.parametrize("blocked", [0.0, 0.1, 0.3, 0.45])
@pytest.mark.parametrize("seed", [0, 1])
def test_equals_dijkstra_on_random_maps(seed, blocked):
    """Oracle: scipy.sparse.csgraph.dijkstra."""
    cost = random_cost(seed, blocked)
    goal = tuple(np.argwhere(np.isfinite(cost))[100 + seed])
    compare(cost, goal)


def test_equals_dijkstra_in_a_winding_corridor():
    """Oracle: scipy.sparse.csgraph.dijkstra; the route's bends need several rounds and far fewer than its cells."""
    cost = spiral_cost()
    solution = compare(cost, (0, 11))
    assert np.all(solution.value.cost[np.isfinite(cost)] < UNREACHABLE)
    assert 4 < solution.iterations < 40


def maze_cost(seed, rooms):
    """A maze without loops, corridors two cells wide and walls one, carved depth first from a corner."""
    rng = np.random.default_rng(seed)
    cost = np.full((3 * rooms, 3 * rooms), np.inf, np.float32)
    path, visited = [(0, 0)], {(0, 0)}
    cost[:2, :2] = 1.0
    while path:
        i, j = path[-1]
        moves = [(i + a, j + b) for a, b in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        moves = [m for m in moves if min(m) >= 0 and max(m) < rooms and m not in visited]
        if not moves:
            path.pop()
            continue
        k, m = moves[rng.integers(len(moves))]
        low, high = (3 * min(i, k), 3 * min(j, m)), (3 * max(i, k) + 2, 3 * max(j, m) + 2)
        cost[low[0] : high[0], low[1] : high[1]] = 1.0
        visited.add((k, m))
        path.append((k, m))
    return cost


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_default_limit_suffices_in_a_maze(seed):
    """Oracle: scipy.sparse.csgraph.dijkstra; the route turns more often than any limit of fixed size allows."""
    cost = maze_cost(seed, 13)
    grid = GridSpec(0.0, 0.0, 0.1, *cost.shape)
    solution = SOLVE(jnp.asarray(cost), jnp.asarray(grid.centres()[0, 0]), grid)
    expected = dijkstra_costs(cost.astype(float), (0, 0), grid.resolution)
    assert solution.status == Status.CONVERGED
    np.testing.assert_allclose(
        solution.value.cost, np.where(np.isfinite(expected), expected, UNREACHABLE), rtol=1e-4, atol=1e-5
    )


def test_routes_dearer_than_the_mark_of_unreachable_cells_are_not_called_converged():
    """Oracle: by construction; the same map in a larger unit is solved."""
    cost = jnp.full(GRID.shape, 9e5)
    dear = SOLVE(cost, centre((3, 3)), GRID)
    assert dear.status == Status.NON_FINITE
    np.testing.assert_array_equal(trusted_cost(dear), UNREACHABLE)
    fair = SOLVE(cost / 1e5, centre((3, 3)), GRID)
    assert fair.status == Status.CONVERGED
    np.testing.assert_array_equal(trusted_cost(fair), fair.value.cost)
    assert jnp.all(fair.value.cost < UNREACHABLE)


def test_no_route_is_claimed_from_a_solve_that_was_cut_short():
    cut = SOLVE(jnp.asarray(spiral_cost()), centre((0, 11)), GRID, 2)
    np.testing.assert_array_equal(trusted_cost(cut), UNREACHABLE)


def test_round_limit_gives_upper_bounds_and_says_so():
    """Oracle: the converged solve."""
    cost = jnp.asarray(spiral_cost())
    full = SOLVE(cost, centre((0, 11)), GRID, 64)
    cut = SOLVE(cost, centre((0, 11)), GRID, 2)
    assert cut.status == Status.MAX_ITERATIONS
    assert cut.residual > 0
    assert np.all(cut.value.cost >= full.value.cost)
    assert np.any(cut.value.cost > full.value.cost)


def test_free_space_is_within_three_percent_of_the_straight_line():
    """Oracle: Euclid's distance; sixteen neighbours overestimate it by at most 2.8 %."""
    goal = centre((4, 7))
    cost = SOLVE(jnp.ones(GRID.shape), goal, GRID, 64).value.cost
    straight = np.linalg.norm(np.asarray(GRID.centres()) - np.asarray(goal), axis=-1)
    ratio = np.asarray(cost)[straight > 0] / straight[straight > 0]
    assert ratio.min() > 1 - 1e-5
    assert 1.02 < ratio.max() < 1.028


def test_blocked_and_outside_goals_use_the_nearest_free_cell():
    """Oracle: the solve for that cell itself, plus the straight line to it by hand."""
    cost = np.full(GRID.shape, 2.0, np.float32)
    cost[10:13, 10:13] = np.inf
    blocked = SOLVE(jnp.asarray(cost), centre((11, 12)), GRID, 64)
    plain = SOLVE(jnp.asarray(cost), centre((11, 13)), GRID, 64)
    np.testing.assert_allclose(blocked.value.goal, centre((11, 13)), atol=1e-6)
    np.testing.assert_allclose(blocked.value.goal_offset, 0.1, atol=1e-6)
    free = np.isfinite(cost)
    np.testing.assert_allclose(blocked.value.cost[free], plain.value.cost[free] + 0.2, atol=1e-5)

    outside = SOLVE(jnp.asarray(cost), jnp.asarray([13.05, 0.05]), GRID, 64)
    np.testing.assert_allclose(outside.value.goal, [2.95, 0.05], atol=1e-5)
    np.testing.assert_allclose(outside.value.cost[29, 10], 2.0 * 10.1, rtol=1e-5)


def test_a_goal_outside_is_reached_over_the_whole_border():
    """Oracle: the solves for each free cell of the border itself, plus the straight line from it by hand."""
    cost = random_cost(3, 0.1)
    goal = np.asarray([4.1, 1.3], np.float32)
    # The border cell nearest to the goal is a pocket: nothing leads to it.
    nearest = np.unravel_index(np.argmin(np.linalg.norm(np.asarray(GRID.centres()) - goal, axis=-1)), GRID.shape)
    cost[nearest[0] - 2 :, nearest[1] - 2 : nearest[1] + 3] = np.inf
    cost[nearest] = 1.0
    over = SOLVE(jnp.asarray(cost), jnp.asarray(goal), GRID, 64, 1.5)
    assert over.status == Status.CONVERGED

    border = [n for n in np.ndindex(GRID.shape) if np.isfinite(cost[n]) and (n[0] in (0, 29) or n[1] in (0, 22))]
    places = jnp.asarray(np.asarray(GRID.centres())[tuple(np.transpose(border))])
    each = jax.jit(jax.vmap(lambda place: cost_to_go(jnp.asarray(cost), place, GRID, 64).value.cost))(places)
    beyond = 1.5 * np.linalg.norm(np.asarray(places) - goal, axis=-1)
    expected = np.minimum(np.min(np.asarray(each) + beyond[:, None, None], axis=0), UNREACHABLE)
    np.testing.assert_allclose(over.value.cost, expected, rtol=1e-5)
    cut_off = SOLVE(jnp.asarray(cost), jnp.asarray(goal), GRID, 64).value.cost
    assert np.mean(cut_off < UNREACHABLE) < 0.01 and np.mean(over.value.cost < UNREACHABLE) > 0.7

    inside = jnp.asarray([1.1, 0.4])
    np.testing.assert_array_equal(
        SOLVE(jnp.asarray(cost), inside, GRID, 64, 1.5).value.cost,
        SOLVE(jnp.asarray(cost), inside, GRID, 64).value.cost,
    )
    assert SOLVE(jnp.asarray(cost), jnp.asarray([jnp.inf, 0.0]), GRID, 64, 1.5).status == Status.NON_FINITE


def test_cut_off_cells_and_bad_maps_are_flagged():
    """Oracle: by construction."""
    cost = np.ones(GRID.shape, np.float32)
    cost[:, 10] = np.inf
    solution = SOLVE(jnp.asarray(cost), centre((3, 3)), GRID, 64)
    assert solution.status == Status.CONVERGED
    np.testing.assert_array_equal(solution.value.cost[:, 10:], UNREACHABLE)
    assert np.all(solution.value.cost[:, :10] < 100)

    closed = SOLVE(jnp.full(GRID.shape, jnp.inf), centre((3, 3)), GRID, 64)
    assert closed.status == Status.INFEASIBLE
    np.testing.assert_array_equal(closed.value.cost, UNREACHABLE)
    for bad in (jnp.nan, 0.0, -1.0):
        solution = SOLVE(jnp.ones(GRID.shape).at[2, 2].set(bad), centre((3, 3)), GRID, 64)
        assert solution.status == Status.NON_FINITE
        assert jnp.all(jnp.isfinite(solution.value.cost))
    assert SOLVE(jnp.ones(GRID.shape), jnp.asarray([jnp.nan, 0.0]), GRID, 64).status == Status.NON_FINITE
    with pytest.raises(InputError, match="shape"):
        cost_to_go(jnp.ones((3, 3)), centre((3, 3)), GRID)


def test_a_batch_equals_a_loop():
    """Oracle: the same maps and goals one by one."""
    costs = jnp.stack([jnp.asarray(random_cost(seed, 0.1 * seed)) for seed in range(4)])
    goals = jnp.asarray([[0.3, 0.4], [2.0, -0.5], [1.1, 1.1], [9.0, -9.0]])
    batch = jax.jit(jax.vmap(lambda c, g: cost_to_go(c, g, GRID)))(costs, goals)
    for n in range(4):
        single = SOLVE(costs[n], goals[n], GRID, 64)
        np.testing.assert_allclose(batch.value.cost[n], single.value.cost, rtol=1e-6)
        assert batch.status[n] == single.status


def test_large_and_nested_batches_equal_a_loop():
    """Oracle: the same goals one by one on one shared map; the batch exceeds what is relaxed together."""
    cost = jnp.asarray(random_cost(7, 0.2))
    rng = np.random.default_rng(0)
    goals = jnp.asarray(rng.uniform((GRID.x_min, GRID.y_min), (GRID.x_max, GRID.y_max), (2, 9, 2)), jnp.float32)
    nested = jax.jit(jax.vmap(jax.vmap(lambda g: cost_to_go(cost, g, GRID))))(goals)
    flat = jax.jit(jax.vmap(lambda g: cost_to_go(cost, g, GRID)))(goals.reshape(18, 2))
    for n in range(0, 18, 5):
        single = SOLVE(cost, goals.reshape(18, 2)[n], GRID, 64)
        for batch in (flat, jax.tree.map(lambda x: x.reshape(18, *x.shape[2:]), nested)):
            np.testing.assert_allclose(batch.value.cost[n], single.value.cost, rtol=1e-6)
            assert batch.iterations[n] == single.iterations


def crossed_cells(route):
    """Cells that the polyline enters, by dense sampling."""
    points = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(route)])
    return np.floor((points - [GRID.x_min, GRID.y_min]) / GRID.resolution).astype(int)


@pytest.mark.parametrize("cost", [random_cost(3, 0.3), spiral_cost()], ids=["random", "winding"])
def test_the_route_reaches_the_goal_and_enters_no_blocked_cell(cost):
    """Oracle: the route's polyline sampled densely, looked up in the map."""
    goal_cell = (0, 11) if np.isfinite(cost[0, 11]) else tuple(np.argwhere(np.isfinite(cost))[0])
    solution = SOLVE(jnp.asarray(cost), centre(goal_cell), GRID, 64)
    reachable = np.argwhere(np.asarray(solution.value.cost) < UNREACHABLE)
    for start in reachable[:: len(reachable) // 10]:
        route = np.asarray(DESCEND(solution.value.cost, GRID, centre(tuple(start)), 400))
        np.testing.assert_allclose(route[0], centre(tuple(start)), atol=1e-6)
        np.testing.assert_allclose(route[-1], solution.value.goal, atol=1e-6)
        cells = crossed_cells(route)
        assert np.all(np.isfinite(cost[cells[:, 0], cells[:, 1]]))
        length = np.sum(np.linalg.norm(np.diff(route, axis=0), axis=-1))
        assert length * np.min(cost) <= solution.value.cost[tuple(start)] * 1.3 + 1e-4


def test_a_batch_of_routes_equals_a_loop():
    """Oracle: the same starts one by one."""
    cost = SOLVE(jnp.asarray(spiral_cost()), centre((0, 11)), GRID, 64).value.cost
    starts = GRID.centres()[jnp.asarray([29, 17, 5]), jnp.asarray([3, 20, 11])]
    batch = jax.jit(jax.vmap(lambda s: descend(cost, GRID, s, 60)))(starts)
    for start, route in zip(starts, batch):
        np.testing.assert_allclose(route, DESCEND(cost, GRID, start, 60), atol=1e-6)


def test_double_precision_maps_are_solved_in_double_precision(x64):
    """Oracle: scipy.sparse.csgraph.dijkstra, to what float32 cannot reach."""
    cost = random_cost(0, 0.2).astype(np.float64)
    goal = tuple(np.argwhere(np.isfinite(cost))[50])
    solution = cost_to_go(jnp.asarray(cost), jnp.asarray(GRID.centres()[goal], jnp.float64), GRID)
    expected = dijkstra_costs(cost, goal, GRID.resolution)
    assert solution.value.cost.dtype == jnp.float64
    np.testing.assert_allclose(solution.value.cost, np.where(np.isfinite(expected), expected, UNREACHABLE), rtol=1e-12)


def test_a_route_from_a_blocked_start_begins_at_the_nearest_reachable_cell():
    """Oracle: by construction; where nothing is reachable, the route stays at the start's cell."""
    cost = np.ones(GRID.shape, np.float32)
    cost[8:, :9] = np.inf
    solution = SOLVE(jnp.asarray(cost), centre((1, 1)), GRID, 64)
    route = DESCEND(solution.value.cost, GRID, centre((20, 8)), 60)
    np.testing.assert_allclose(route[0], centre((20, 9)), atol=1e-6)
    np.testing.assert_allclose(route[-1], centre((1, 1)), atol=1e-6)
    stuck = DESCEND(jnp.full(GRID.shape, UNREACHABLE), GRID, centre((5, 5)), 4)
    np.testing.assert_allclose(stuck, np.broadcast_to(centre((5, 5)), (4, 2)), atol=1e-6)
