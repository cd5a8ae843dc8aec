"""What the solver claims is true, in whatever units; what it cannot know it does not claim."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks.qp_verdicts import count_verdicts
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import QuadraticProgram, Status, cold_start, explain, solve_qp

INF = np.inf
solve = jax.jit(solve_qp)


def program(dtype, *arrays) -> QuadraticProgram:
    P, q, C, low, high = (jnp.asarray(np.asarray(a, dtype)) for a in arrays)
    return QuadraticProgram(P, q, C, low, high)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_ugly_programs_are_judged_truly(x64, dtype):
    """Oracles: Clarabel, HiGHS and construction. `benchmarks.qp_verdicts` does the same by the thousand."""
    for name, counts in count_verdicts(12, 5, dtype).items():
        silent = counts.pop("no claim")
        assert not any(counts.values()), (name, counts)
        assert silent <= 10, name


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_units_of_the_variables_do_not_matter(x64, dtype):
    """Oracle: by hand, x = r y = 1/2 and x = 1, r y = 2 whatever the unit r of y."""
    for unit in 10.0 ** -np.arange(0, 16, 3):
        P, rows = np.diag([1, unit**2]), np.array([[1, unit], [0, unit]])
        first = solve(program(dtype, P, [-1, -unit], rows, [-INF, -1], [1, 1]))
        second = solve(program(dtype, P, [0, 0], [[1, unit], [1, 0]], [3, -1], [INF, 1]))
        for solution, expected in ((first, [0.5, 0.5]), (second, [1, 2])):
            assert int(solution.status) == Status.CONVERGED
            np.testing.assert_allclose(np.asarray(solution.value.x) * [1, unit], expected, rtol=1e-3)


@pytest.mark.parametrize("curvature", [0.0, 1.0])
def test_bounds_that_just_miss_each_other(curvature):
    """Oracle: by hand. x <= 0 and x >= miss contradict each other however small the miss, and meet if there is none."""
    rows = [[1.0], [1.0]]
    for miss in (1e-2, 1e-4, 1e-6, 1e-9):
        solution = solve(program(np.float32, [[curvature]], [1.0], rows, [-INF, miss], [0.0, INF]))
        assert int(solution.status) == Status.INFEASIBLE
    touching = solve(program(np.float32, [[curvature]], [1.0], rows, [-INF, 0.0], [0.0, INF]))
    assert int(touching.status) == Status.CONVERGED
    np.testing.assert_allclose(touching.value.x, 0, atol=1e-6)


@pytest.mark.parametrize("size", [1e-30, 1e-15, 1e15, 1e30])
def test_extreme_sizes_are_solved_or_told(size):
    """Oracle: by hand, the optimum is (-1/4, 5/4) in units of `size`; no derivative where squares leave the range."""
    for variables, cost in ((size, 1.0), (1.0, size), (size, size)):
        unit = np.float32(1 / variables)
        with np.errstate(over="ignore", under="ignore"):
            P, q = (2 * np.eye(2) * cost * float(unit) ** 2).astype(np.float32), cost * unit * np.array([-2, -5])
        solution = solve(program(np.float32, P, q, np.ones((1, 2)) * unit, [1], [1]))
        assert np.all(np.isfinite(solution.value.x))
        if np.all(np.isfinite(P)) and np.all(np.diagonal(P) > 0):
            assert int(solution.status) == Status.CONVERGED
            np.testing.assert_allclose(np.asarray(solution.value.x) * unit, [-0.25, 1.25], rtol=1e-3)
        else:
            assert not bool(solution.gradient_valid)


@pytest.mark.parametrize("kind", ["int", "list", "float16", "bfloat16", "float64"])
def test_any_real_numbers_are_solved(kind, unchecked_types):
    """Oracle: by hand."""
    data = ([[2, 0], [0, 2]], [-2, -5], [[1, 1]], [1], [1])
    convert = {"list": lambda v: v, "int": np.asarray, "float64": lambda v: np.asarray(v, float)}.get(
        kind, lambda v: jnp.asarray(v, kind)
    )
    case = QuadraticProgram(*(convert(v) for v in data))
    solution = solve_qp(case, cold_start(case))
    np.testing.assert_allclose(solution.value.x, [-0.25, 1.25], atol=1e-5)
    assert solution.value.x.dtype == jnp.float32 and "Converged" in explain(case, solution)


@pytest.mark.parametrize("bad", [[["a"]], [[1j]], [[1.0], [1.0, 2.0]], None])
def test_what_is_no_number_is_refused(bad, unchecked_types):
    with pytest.raises(InputError, match="give real numbers"):
        solve_qp(QuadraticProgram(bad, np.ones(1), np.ones((1, 1)), np.zeros(1), np.ones(1)))


def test_a_tie_has_no_derivative_and_a_margin_tells_how_near_it_is(x64):
    """Oracle: by hand. min x^2 / 2 - x with x <= 1 + d: the bound is d away from the optimum, or pushes with -d."""
    for distance in (-0.5, -1e-3, 0.0, 1e-3, 0.5):
        solution = solve(program(np.float64, [[1.0]], [-1.0], [[1.0]], [-INF], [1 + distance]))
        assert int(solution.status) == Status.CONVERGED
        assert bool(solution.gradient_valid) == (distance != 0)
        size = min(1, 1 + distance)
        np.testing.assert_allclose(solution.margin, abs(distance) / size if distance else 0, atol=1e-9)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_minimisers_that_are_not_unique(x64, dtype):
    """Oracle: by hand. A free variable, two best corners of a simplex, a row twice, an inequality on an equality."""
    eye, simplex = np.eye(2), np.vstack([np.ones((1, 3)), np.eye(3)])
    ties = [
        (np.diag([1.0, 0]), [-1, 0], eye, [-5, -1], [5, 1]),
        (np.zeros((3, 3)), [-0.2, -0.2, 0.1], simplex, [1, 0, 0, 0], [1, INF, INF, INF]),
        (eye, [-2, -2], [[1, 0], [1, 0]], [-INF, -INF], [1, 1]),
        (eye, [-2, -2], [[1, 0], [1, 0]], [1, -INF], [1, 1]),
        (eye, [-1, -1], eye, [-INF, -INF], [1, 5]),
    ]
    for tie in ties:
        solution = solve(program(dtype, *tie))
        assert int(solution.status) == Status.CONVERGED and not bool(solution.gradient_valid), tie
    held = solve(program(dtype, np.diag([1.0, 0]), [-1, -1], eye, [-5, -1], [5, 1]))
    assert int(held.status) == Status.CONVERGED and bool(held.gradient_valid)
