"""General quadratic programs: answers against Clarabel, honest statuses on hard ones, invariances, batches."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.problems.hard_qps import hard_qps
from benchmarks.problems.whole_body_qps import whole_body_qps
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import (
    QpPoint,
    QpSettings,
    QuadraticProgram,
    Status,
    cold_start,
    control_settings,
    explain,
    solve_qp,
)
from tests.optimization.qp.qp_peers import clarabel_solution

solve = jax.jit(solve_qp, static_argnames=("settings", "gradient"))
OUTCOMES = {
    "infeasible": {Status.INFEASIBLE},
    "unbounded": {Status.UNBOUNDED},
    "not convex": {Status.NOT_CONVEX},
    "no solution": set(Status) - {Status.CONVERGED},
}


def program(case, dtype=jnp.float32) -> QuadraticProgram:
    return QuadraticProgram(*(jnp.asarray(a, dtype) for a in case[:5]))


def cost(case, x) -> float:
    x = np.asarray(x, float)
    return x @ case.P @ x / 2 + case.q @ x


def assert_finite(solution) -> None:
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((solution.value, solution.iterations)))


def assert_truthful(case, solution, tolerance: float) -> None:
    """Oracle: Clarabel. An unconverged solve may say so; a converged one must be right, an impossible one noticed."""
    assert_finite(solution)
    status = Status(int(solution.status))
    if case.outcome != "solved":
        assert status != Status.CONVERGED
        assert not bool(solution.gradient_valid)
        return
    assert status in (Status.CONVERGED, Status.MAX_ITERATIONS)
    if status == Status.CONVERGED:
        expected = clarabel_solution(*case[:5])
        scale = abs(cost(case, expected)) + np.abs(case.q) @ np.abs(expected)
        assert abs(cost(case, solution.value.x) - cost(case, expected)) <= tolerance * scale + 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_hard_programs_in_single_precision(seed):
    missed = 0
    for case in hard_qps(seed).values():
        case = case._replace(**{k: np.asarray(getattr(case, k), np.float32) for k in ("P", "q", "C", "low", "high")})
        solution = jax.device_get(solve(program(case)))
        assert_truthful(case, solution, 3e-3)
        missed += case.outcome == "solved" and int(solution.status) != Status.CONVERGED
    assert missed <= 2


@pytest.mark.parametrize(("dtype", "tolerance"), [("float32", 3e-3), ("float64", 1e-5)])
def test_hard_programs_by_admm(x64, dtype, tolerance):
    """Oracle: Clarabel. ADMM may fail where the active set does not, and then says so."""
    missed = 0
    for case in hard_qps(0).values():
        case = case._replace(**{k: np.asarray(getattr(case, k), dtype) for k in ("P", "q", "C", "low", "high")})
        solution = jax.device_get(solve(program(case, dtype), settings=QpSettings("admm")))
        assert_truthful(case, solution, tolerance)
        missed += case.outcome == "solved" and int(solution.status) != Status.CONVERGED
    assert missed <= 4


@pytest.mark.parametrize("seed", range(3))
def test_hard_programs_in_double_precision(x64, seed):
    for name, case in hard_qps(seed).items():
        solution = jax.device_get(solve(program(case, jnp.float64)))
        assert_truthful(case, solution, 1e-5)
        if case.outcome == "solved" and name != "semidefinite":
            assert int(solution.status) == Status.CONVERGED, name
        if case.outcome in OUTCOMES:
            assert Status(int(solution.status)) in OUTCOMES[case.outcome], name


def test_least_violation(x64):
    """Oracle: by hand. x = 1 and x = -1 contradict each other; y is free to take its cheapest value."""
    case = QuadraticProgram(
        jnp.eye(2),
        jnp.array([0.0, -3.0]),
        jnp.array([[1.0, 0], [1, 0], [0, 1]]),
        jnp.array([1.0, -1, -9]),
        jnp.array([1.0, -1, 9]),
        (("reach", 2), ("speed", 1)),
    )
    solution = solve(case)
    assert int(solution.status) == Status.INFEASIBLE
    np.testing.assert_allclose(solution.value.x, [0, 3], atol=1e-5)
    np.testing.assert_allclose(solution.value.block_violation, [1, 0], atol=1e-5)
    assert "'reach'" in explain(case, solution)


def test_crossed_bounds_are_infeasible():
    case = program(hard_qps()["benign"])
    solution = solve(replace(case, low=case.low.at[0].set(case.high[0] + 1)))
    assert int(solution.status) == Status.INFEASIBLE
    assert_finite(solution)


@pytest.mark.parametrize("field", ["P", "q", "C", "low", "high"])
def test_nan_is_reported_and_kept_out(field):
    case = program(hard_qps()["benign"])
    array = getattr(case, field)
    solution = solve(replace(case, **{field: array.at[(0,) * array.ndim].set(jnp.nan)}))
    assert int(solution.status) == Status.NON_FINITE and not bool(solution.gradient_valid)
    assert_finite(solution)


def test_rows_may_be_scaled_and_permuted(x64):
    """Property: the solution does not depend on the rows' scales and order; multipliers follow."""
    case = program(hard_qps()["benign"], jnp.float64)
    rng = np.random.default_rng(0)
    order, scale = rng.permutation(case.low.size), 10 ** rng.uniform(-3, 3, case.low.size)
    rows = {k: scale * getattr(case, k)[order] for k in ("low", "high")}
    before, after = solve(case), solve(replace(case, C=scale[:, None] * case.C[order], **rows))
    np.testing.assert_allclose(after.value.x, before.value.x, atol=1e-9)
    np.testing.assert_allclose(after.value.y * scale, before.value.y[order], atol=1e-8)


@pytest.fixture(scope="module")
def walk():
    """A stretch of whole-body programs (16, 22 variables, 30 rows) with a contact switch, single precision."""
    walk = whole_body_qps(96, seed=3)
    return QuadraticProgram(*(jnp.asarray(getattr(walk, k)[::6], jnp.float32) for k in ("P", "q", "C", "low", "high")))


def test_batch_equals_loop_and_rows_are_independent(walk):
    """Property: vmap = loop; spoiling every other program, one by NaN, changes nothing in the rest."""
    batched = jax.jit(jax.vmap(solve_qp))
    together = batched(walk)
    for k in range(walk.q.shape[0]):
        alone = solve(jax.tree.map(lambda a, k=k: a[k], walk))
        size = np.abs(alone.value.x).max()
        np.testing.assert_allclose(together.value.x[k], alone.value.x, atol=1e-3 * size)
    spoilt = replace(walk, q=walk.q.at[1::2].multiply(-3).at[1].set(jnp.nan), high=walk.high.at[3].add(-50))
    np.testing.assert_array_equal(batched(spoilt).value.x[::2], together.value.x[::2])
    nested = jax.jit(jax.vmap(jax.vmap(solve_qp)))(jax.tree.map(lambda a: a.reshape(2, 8, *a.shape[1:]), walk))
    np.testing.assert_array_equal(nested.value.x.reshape(16, -1), together.value.x)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (5, 9), (6, 7)])
def test_batches_of_any_size_and_shape(x64, n, m):
    """Oracle: Clarabel; odd and even sizes, which are worked off in pairs, and a last chunk that is not full."""
    rng = np.random.default_rng(n)
    roots = rng.normal(size=(19, n, n))
    P = roots @ np.swapaxes(roots, 1, 2) + 0.1 * np.eye(n)
    q, C = 3 * rng.normal(size=(19, n)), rng.normal(size=(19, m, n))
    middle = np.einsum("bij,bj->bi", C, rng.normal(size=(19, n)))
    data = (P, q, C, middle - rng.uniform(0.1, 1, (19, m)), middle + rng.uniform(0.1, 1, (19, m)))
    solution = jax.jit(jax.vmap(solve_qp))(QuadraticProgram(*(jnp.asarray(a) for a in data)))
    assert np.all(np.asarray(solution.status) == Status.CONVERGED)
    expected = np.stack([clarabel_solution(*(a[k] for a in data)) for k in range(19)])
    np.testing.assert_allclose(solution.value.x, expected, atol=1e-6)
    assert np.any(np.asarray(solution.value.sides) != 0)


@pytest.mark.parametrize(
    "settings",
    [QpSettings(well_posed=True), control_settings(), control_settings("admm")],
    ids=["default", "control", "admm"],
)
def test_whole_body_torques(settings):
    """Oracle: Clarabel. Warm-started along a walk with pushes, torques are within 1 % and constraints within 1e-3."""
    walk = whole_body_qps(120, seed=5)
    stack = QuadraticProgram(*(jnp.asarray(getattr(walk, k), jnp.float32) for k in ("P", "q", "C", "low", "high")))

    def tick(guess: QpPoint, problem: QuadraticProgram):
        solution = solve_qp(problem, guess, settings, "stopped")
        return solution.value, solution

    start = cold_start(jax.tree.map(lambda a: a[0], stack))
    solutions = jax.jit(partial(jax.lax.scan, tick))(start, stack)[1]
    assert np.all(solutions.status == Status.CONVERGED)
    assert np.mean(solutions.gradient_valid) > 0.8
    for k in range(0, 120, 10):
        expected = clarabel_solution(walk.P[k], walk.q[k], walk.C[k], walk.low[k], walk.high[k])
        torque = walk.torque_map[k] @ expected + walk.torque_offset[k]
        error = walk.torque_map[k] @ (np.asarray(solutions.value.x[k]) - expected)
        assert np.max(np.abs(error)) <= 0.01 * np.max(np.abs(torque))
    assert np.max(solutions.value.violation) <= 1e-3 * np.max(np.abs(solutions.value.x))


def test_warm_start_needs_no_search(x64):
    """Property: from the solution, only the active rows are swept in."""
    case = program(hard_qps()["benign"], jnp.float64)
    cold = solve(case)
    warm = solve(case, cold.value)
    np.testing.assert_allclose(warm.value.x, cold.value.x, atol=1e-9)
    assert int(warm.iterations) <= np.count_nonzero(cold.value.sides) + 3


def test_starts_of_any_quality_give_the_same_answer():
    case = program(hard_qps()["equalities"])
    expected = solve(case)
    for size in (1.0, 1e6, np.nan):
        rng = np.random.default_rng(1)
        start = cold_start(case)._replace(
            x=jnp.asarray(size * rng.normal(size=case.q.size), jnp.float32),
            y=jnp.asarray(size * rng.normal(size=case.low.size), jnp.float32),
        )
        solution = solve(case, start)
        assert int(solution.status) == Status.CONVERGED
        np.testing.assert_allclose(solution.value.x, expected.value.x, atol=1e-3)


def test_wrong_calls_are_refused(unchecked_types):
    case = program(hard_qps()["benign"])
    with pytest.raises(InputError, match="gradient"):
        solve_qp(case, gradient="exact")
    with pytest.raises(InputError, match="shapes"):
        solve_qp(replace(case, q=case.q[:-1]))
    with pytest.raises(InputError, match="blocks"):
        solve_qp(replace(case, blocks=(("friction", 3),)))
    with pytest.raises(InputError, match="relaxation"):
        QpSettings(relaxation=2.5)
