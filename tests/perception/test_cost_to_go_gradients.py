"""Derivatives of the cost-to-go: central differences in double precision, and the cells of the best route."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.optimization import Status
from iwalker_jax.perception.cost_to_go import UNREACHABLE, cost_to_go, trusted_cost
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.map_sampling import sample_bilinear
from tests.gradients import assert_gradients_agree

GRID = GridSpec(x_min=0.0, y_min=-1.0, resolution=0.1, rows=14, columns=11)
GOAL = jnp.asarray([0.234, -0.571])


def rough_cost(seed: int, blocked: float) -> np.ndarray:
    """Random costs: no two routes cost the same."""
    rng = np.random.default_rng(seed)
    cost = rng.uniform(0.5, 5.0, GRID.shape)
    return np.where(rng.random(GRID.shape) < blocked, np.inf, cost)


@pytest.mark.parametrize("blocked", [0.0, 0.3])
def test_derivatives_in_cost_and_goal(blocked, x64):
    """Oracle: central differences of the converged field, and forward against reverse mode."""
    cost = rough_cost(3, blocked)
    free = jnp.asarray(np.isfinite(cost))

    @jax.jit
    def field(values, goal):
        found = trusted_cost(cost_to_go(jnp.where(free, values, jnp.inf), goal, GRID))
        # A mark of a million would round the differences away.
        return jnp.where(found < UNREACHABLE, found, 0.0)

    solution = cost_to_go(jnp.asarray(cost), GOAL.astype(jnp.float64), GRID)
    assert solution.gradient_valid and solution.status == Status.CONVERGED
    assert (np.asarray(solution.value.cost) < UNREACHABLE).sum() > 80
    assert_gradients_agree(field, jnp.asarray(np.where(free, cost, 1.0)), GOAL.astype(jnp.float64))


def test_the_whole_jacobian_equals_central_differences(x64):
    """Oracle: central differences, cell by cell: of cells off the route they are zero."""
    cost = jnp.asarray(rough_cost(5, 0.2))
    reachable = np.asarray(cost_to_go(cost, GOAL.astype(jnp.float64), GRID).value.cost) < UNREACHABLE
    start = tuple(np.argwhere(reachable)[-1])

    @jax.jit
    def at_start(cost):
        return cost_to_go(cost, GOAL.astype(jnp.float64), GRID).value.cost[start]

    found = np.asarray(jax.grad(at_start)(cost))
    for cell in np.ndindex(GRID.shape):
        if np.isfinite(cost[cell]):
            step = jnp.zeros(GRID.shape).at[cell].set(1e-6)
            assert found[cell] == pytest.approx(float(at_start(cost + step) - at_start(cost - step)) / 2e-6, abs=1e-7)
    assert np.all(found[~np.isfinite(cost)] == 0)


def test_in_a_corridor_each_cell_counts_with_the_way_through_it():
    """Oracle: by hand; the only route is a straight line, its ends count half a cell."""
    cost = np.full(GRID.shape, np.inf, np.float32)
    cost[2:12, 4] = 2.0
    goal = jnp.asarray(GRID.centres()[2, 4])

    def at_end(cost):
        return cost_to_go(cost, goal, GRID).value.cost[11, 4]

    expected = np.zeros(GRID.shape)
    expected[2:12, 4] = 0.1
    expected[[2, 11], 4] = 0.05
    np.testing.assert_allclose(jax.grad(at_end)(jnp.asarray(cost)), expected, atol=1e-7)


def test_a_cost_is_its_derivative_times_the_traversal_cost():
    """Oracle: Euler's theorem; the cost of a route is homogeneous of degree one in the traversal cost."""
    cost = jnp.asarray(rough_cost(1, 0.1), jnp.float32)
    free = jnp.isfinite(cost)

    def field(scale):
        return cost_to_go(scale * cost, GOAL, GRID).value.cost

    value, change = jax.jvp(field, (1.0,), (1.0,))
    reachable = value < UNREACHABLE
    np.testing.assert_allclose(change, jnp.where(reachable, value, 0.0), rtol=1e-5)
    assert reachable.sum() > 0.8 * free.sum()


def test_the_goals_derivative_is_that_of_the_last_straight_line():
    """Oracle: by hand; zero in the very centre of a cell, where the line has no direction."""
    cost = jnp.full(GRID.shape, 3.0)

    def at_start(goal):
        return cost_to_go(cost, goal, GRID).value.cost[12, 9]

    centre = jnp.asarray(GRID.centres()[2, 4])
    np.testing.assert_allclose(jax.grad(at_start)(centre + jnp.asarray([0.03, -0.04])), [1.8, -2.4], rtol=1e-4)
    np.testing.assert_array_equal(jax.grad(at_start)(centre), 0)


def test_derivatives_over_the_border_agree_with_differences(x64):
    """Oracle: central differences, forward and reverse, in the costs, the goal outside and the price outside."""
    cost = jnp.asarray(rough_cost(4, 0.1))
    free = jnp.isfinite(cost)

    def over_the_border(values, goal, outside):
        found = cost_to_go(jnp.where(free, values, jnp.inf), goal, GRID, outside_cost=outside).value.cost
        return jnp.where(found < UNREACHABLE, found, 0.0)

    assert_gradients_agree(over_the_border, jnp.where(free, cost, 1.0), jnp.asarray([5.3, 2.9]), jnp.asarray(1.7))


def test_a_slope_over_more_than_a_cell_is_that_of_the_starts_field(x64):
    """Oracle: central differences, and that routes cost the same both ways."""
    cost = jnp.asarray(rough_cost(2, 0.0))
    start, goal = jnp.asarray(GRID.centres()[12, 9]), jnp.asarray(GRID.centres()[3, 2])
    there = cost_to_go(cost, goal, GRID).value.cost
    back = cost_to_go(cost, start, GRID).value.cost
    np.testing.assert_allclose(back[3, 2], there[12, 9], rtol=1e-12)
    assert_gradients_agree(lambda place: sample_bilinear(back, GRID, place, outside="clamp"), goal + 0.013)


def test_what_has_no_route_has_no_derivative():
    """Oracle: by construction; cut-off cells, blocked maps, and input that is no number give zeros, never NaN."""
    cut = np.ones(GRID.shape, np.float32)
    cut[:, 6] = np.inf

    def total(cost, goal):
        return jnp.sum(cost_to_go(cost, goal, GRID).value.cost)

    slope = jax.jit(jax.grad(total, argnums=(0, 1)))
    in_cost, in_goal = slope(jnp.asarray(cut), GOAL)
    np.testing.assert_array_equal(in_cost[:, 6:], 0)
    assert np.all(np.asarray(in_cost[:, :6]) > 0) and np.all(np.isfinite(in_goal))

    beyond = lambda cost: jnp.sum(cost_to_go(cost, GOAL, GRID).value.cost[:, 6:])  # noqa: E731
    np.testing.assert_array_equal(jax.grad(beyond)(jnp.asarray(cut)), 0)

    closed = jnp.full(GRID.shape, jnp.inf)
    open_map = jnp.ones(GRID.shape)
    for cost, goal in (
        (closed, GOAL),
        (open_map, jnp.asarray([jnp.nan, 0.0])),
        (open_map, jnp.asarray([jnp.inf, -jnp.inf])),
        (open_map, jnp.asarray([1e30, 0.0])),
        (open_map.at[2, 2].set(jnp.nan), GOAL),
        (open_map.at[2, 2].set(-1.0), GOAL),
        (9e5 * open_map, GOAL),
    ):
        solution = cost_to_go(cost, goal, GRID)
        assert solution.gradient_valid == (solution.status == Status.CONVERGED)
        assert not solution.gradient_valid or np.isfinite(goal).all()
        for part in slope(cost, goal):
            assert np.all(np.isfinite(part))
        _, change = jax.jvp(total, (cost, goal), (jnp.ones_like(cost), jnp.ones_like(goal)))
        assert np.isfinite(change)


def test_a_solve_that_was_cut_short_is_flagged_and_finite():
    """Oracle: the status."""
    cost = jnp.asarray(rough_cost(4, 0.35), jnp.float32)
    solution = cost_to_go(cost, GOAL, GRID, 1)
    assert solution.status == Status.MAX_ITERATIONS and not solution.gradient_valid
    slope = jax.grad(lambda cost: jnp.sum(cost_to_go(cost, GOAL, GRID, 1).value.cost))(cost)
    assert np.all(np.isfinite(slope))


def test_where_two_routes_cost_the_same_the_derivative_is_one_of_theirs(x64):
    """Oracle: one-sided differences; the cost is concave, so that derivatives lie between the two."""
    cost = np.full(GRID.shape, np.inf)
    cost[2:9, [3, 7]] = 1.0
    cost[[2, 8], 3:8] = 1.0
    goal = jnp.asarray(GRID.centres()[2, 5])
    at_start = lambda cost: cost_to_go(cost, goal, GRID).value.cost[8, 5]  # noqa: E731
    found = np.asarray(jax.grad(at_start)(jnp.asarray(cost)))
    one_way = jnp.zeros(GRID.shape).at[3:8, 3].set(1e-6)
    dearer = float(at_start(cost + one_way) - at_start(jnp.asarray(cost))) / 1e-6
    cheaper = float(at_start(jnp.asarray(cost)) - at_start(cost - one_way)) / 1e-6
    assert dearer == pytest.approx(0.0, abs=1e-6) and cheaper == pytest.approx(0.5, abs=1e-6)
    assert found[3:8, 3].sum() == pytest.approx(0.5) or found[3:8, 7].sum() == pytest.approx(0.5)
    assert found.sum() == pytest.approx(float(at_start(jnp.asarray(cost))))


def test_batches_of_derivatives_equal_a_loop():
    """Oracle: the maps and goals one by one; more maps than are relaxed together, nested, and compiled."""
    costs = jnp.stack([jnp.asarray(rough_cost(seed, 0.05 * (seed % 4)), jnp.float32) for seed in range(18)])
    goals = jnp.asarray(np.random.default_rng(0).uniform((0.0, -1.0), (1.4, 0.1), (18, 2)), jnp.float32)

    def mean(cost, goal):
        return jnp.mean(jnp.minimum(cost_to_go(cost, goal, GRID).value.cost, 100.0))

    slope = jax.grad(mean, argnums=(0, 1))
    batch = jax.jit(jax.vmap(slope))(costs, goals)
    nested = jax.jit(jax.vmap(jax.vmap(slope)))(costs.reshape(2, 9, *GRID.shape), goals.reshape(2, 9, 2))
    outside = jax.jit(jax.grad(lambda costs, goals: jnp.sum(jax.vmap(mean)(costs, goals)), argnums=(0, 1)))(
        costs, goals
    )
    for n in range(0, 18, 4):
        single = jax.jit(slope)(costs[n], goals[n])
        for many in (batch, jax.tree.map(lambda x: x.reshape(18, *x.shape[2:]), nested), outside):
            np.testing.assert_allclose(many[0][n], single[0], atol=1e-6)
            np.testing.assert_allclose(many[1][n], single[1], atol=1e-6)
