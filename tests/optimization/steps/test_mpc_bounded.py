"""Step MPC with reachability against Clarabel and OSQP, closed-loop simulation and finite differences."""

import clarabel
import jax
import jax.numpy as jnp
import numpy as np
import osqp
import pytest
from jax.flatten_util import ravel_pytree
from scipy import sparse

from benchmarks.problems.step_qps import build_step_qp, irregular_walk, step_map
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import (
    HlipParameters,
    Status,
    StepMpcWeights,
    StepReach,
    solve_bounded_step_mpc,
    solve_step_mpc,
    step_bounds,
)
from iwalker_jax.optimization.steps import box_qp

BRUCE = HlipParameters()
HORIZON = 12
REACH = (0.2, 0.04, 0.2)


@jax.jit
def compiled(footsteps, state, stance, headings, reach):
    """One program for all tests of one precision."""
    return solve_bounded_step_mpc(footsteps, state, stance, headings, StepReach(*reach))


def solve(footsteps, state, stance, headings, reach=REACH):
    """The plan, every argument in the footsteps' precision."""
    dtype = footsteps.dtype
    return compiled(footsteps, state, np.asarray(stance, dtype), headings, np.asarray(reach, dtype))


def rough_walk(seed, noise=0.06, kick=0.05, horizon=HORIZON):
    """Footsteps so irregular that several bounds are active."""
    return irregular_walk(horizon, seed, noise, kick, turn=0.15 * np.sin(seed))


def bounds(stance=1.0):
    """Bounds as NumPy rows (N, 2)."""
    return (np.asarray(x, float) for x in step_bounds(StepReach(*REACH), jnp.asarray(stance), HORIZON))


def in_heading(inputs, headings):
    """Steps turned into their heading frames."""
    cos, sin = np.cos(headings), np.sin(headings)
    return np.stack([cos * inputs[:, 0] + sin * inputs[:, 1], -sin * inputs[:, 0] + cos * inputs[:, 1]], 1)


def clarabel_plan(footsteps, state, headings, stance=1.0):
    """Footsteps of Clarabel's optimum."""
    qp = build_step_qp(footsteps, state, BRUCE, StepMpcWeights(), headings)
    low, high = bounds(stance)
    rows = sparse.csc_matrix(np.concatenate([qp.dynamics, qp.heading, -qp.heading]))
    values = np.concatenate([qp.drift, high.ravel(), -low.ravel()])
    cones = [clarabel.ZeroConeT(len(qp.drift)), clarabel.NonnegativeConeT(2 * high.size)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    hessian = sparse.csc_matrix(np.triu(qp.hessian))
    result = clarabel.DefaultSolver(hessian, qp.linear, rows, values, cones, settings).solve()
    return qp.unpack(np.asarray(result.x))[0]


def test_equals_clarabel(x64):
    """Oracle: Clarabel, to 1e-5 m; enough bounds must be active for the comparison to mean something."""
    low, high = bounds()
    active = 0
    for seed in range(12):
        footsteps, state, headings = rough_walk(seed)
        solution = solve(footsteps, state, 1.0, headings)
        if solution.status == Status.INFEASIBLE:
            continue
        assert solution.status == Status.CONVERGED
        np.testing.assert_allclose(solution.value.footsteps, clarabel_plan(footsteps, state, headings), atol=1e-5)
        steps = in_heading(np.asarray(solution.value.inputs), headings)
        active += np.sum((steps < low + 1e-9) | (steps > high - 1e-9))
    assert active > 40


def test_equals_osqp(x64):
    """Oracle: OSQP."""
    footsteps, state, headings = rough_walk(1)
    qp = build_step_qp(footsteps, state, BRUCE, StepMpcWeights(), headings)
    low, high = bounds()
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(qp.hessian)),
        qp.linear,
        sparse.csc_matrix(np.concatenate([qp.dynamics, qp.heading])),
        np.concatenate([qp.drift, low.ravel()]),
        np.concatenate([qp.drift, high.ravel()]),
        verbose=False,
        eps_abs=1e-9,
        eps_rel=1e-9,
        max_iter=200000,
    )
    z = np.asarray(solver.solve(raise_error=False).x)
    np.testing.assert_allclose(solve(footsteps, state, 1.0, headings).value.footsteps, qp.unpack(z)[0], atol=1e-5)


def test_float32_accuracy():
    """Oracle: Clarabel in float64, to 1 mm, for every plan that says it has converged; nine in ten must."""
    converged = 0
    for seed in range(20):
        problem = rough_walk(seed, kick=0.03)
        solution = solve(*(x.astype(np.float32) for x in problem[:2]), 1.0, problem[2].astype(np.float32))
        if solution.status == Status.CONVERGED:
            converged += 1
            np.testing.assert_allclose(solution.value.footsteps, clarabel_plan(*problem), atol=1e-3)
    assert converged >= 18


def test_loose_bounds_change_nothing(x64):
    """Oracle: the unbounded MPC."""
    footsteps, state, headings = rough_walk(0)
    free = solve_step_mpc(footsteps, state).value
    loose = solve(footsteps, state, 1.0, headings, (9.0, -9.0, 9.0))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-10), loose.value, free)
    assert loose.iterations == 0 and loose.status == Status.CONVERGED


def test_symmetries(x64):
    """Properties: moving, turning and mirroring (left becomes right) the problem does the same to the plan."""
    footsteps, state, headings = rough_walk(1)
    plan = solve(footsteps, state, 1.0, headings).value
    cos, sin = np.cos(0.7), np.sin(0.7)
    turn = np.array([[cos, -sin], [sin, cos]])
    turned = solve(footsteps @ turn.T, turn @ state, 1.0, headings + 0.7).value
    np.testing.assert_allclose(turned.footsteps, plan.footsteps @ turn.T, atol=1e-9)
    mirror = np.diag([1.0, -1.0])
    mirrored = solve(footsteps @ mirror, mirror @ state, -1.0, -headings).value
    np.testing.assert_allclose(mirrored.footsteps, plan.footsteps @ mirror, atol=1e-9)
    shift = np.array([3.0, -2.0])
    moved = solve(footsteps + shift, state + np.outer(shift, [1, 0, 0]), 1.0, headings).value
    np.testing.assert_allclose(moved.footsteps, plan.footsteps + shift, atol=1e-9)


def scalar_of(values, gradient="implicit"):
    """A scalar that depends on every output, from all differentiable inputs."""
    footsteps, state, headings, reach, physics, factors = values
    solution = solve_bounded_step_mpc(
        footsteps,
        state,
        1.0,
        headings,
        StepReach(*reach),
        HlipParameters(*physics),
        StepMpcWeights(*factors),
        gradient,
    )
    rng = np.random.default_rng(5)
    plan = solution.value
    parts = [jnp.sum(rng.normal(size=x.shape) * x) for x in (plan.footsteps, plan.states, plan.inputs)]
    return sum(parts) + 0.3 * plan.cost, solution


def test_gradients_of_every_input(x64):
    """Oracle: central differences; forward and reverse mode, implicit and unrolled, with bounds active."""
    problem = rough_walk(1, horizon=4)
    reach, physics = np.array([0.1, 0.05, 0.15]), np.array([0.365, 0.24, 0.03, 9.81])
    flat, unravel = ravel_pytree((*problem, reach, physics, np.array([100.0, 3.0, 50.0, 2.0, 30.0])))
    value = jax.jit(lambda x: scalar_of(unravel(x)))
    _, solution = value(flat)
    steps = np.abs(in_heading(np.asarray(solution.value.inputs), problem[2]))
    assert solution.gradient_valid
    assert np.sum(np.abs(steps[:, 0] - 0.1) < 1e-9) > 0 and np.sum(np.abs(steps[:, 1] - 0.05) < 1e-9) > 0
    size = 1e-6 * np.maximum(np.abs(flat), 0.1)
    central = [(value(flat + h * e)[0] - value(flat - h * e)[0]) / (2 * h) for h, e in zip(size, np.eye(flat.size))]
    reverse = jax.jit(jax.grad(lambda x: scalar_of(unravel(x))[0]))(flat)
    push = jax.jit(lambda x, e: jax.jvp(lambda y: scalar_of(unravel(y))[0], (x,), (e,))[1])
    forward = [push(flat, e) for e in np.eye(flat.size)]
    unrolled = jax.jit(jax.grad(lambda x: scalar_of(unravel(x), "unrolled")[0]))(flat)
    for slope in (reverse, forward, unrolled):
        np.testing.assert_allclose(slope, central, rtol=1e-5, atol=1e-6)
    stopped = jax.jit(jax.grad(lambda x: scalar_of(unravel(x), "stopped")[0]))(flat)
    np.testing.assert_array_equal(stopped, 0)


def test_hopeless_push_is_reported(x64):
    """Oracle: the bounds themselves. A push no step can catch is INFEASIBLE, and the plan still within reach."""
    footsteps, state, headings = rough_walk(0, noise=0.0, kick=0.0)
    state[1, 2] = -2.5
    solution = solve(footsteps, state, 1.0, headings)
    assert solution.status == Status.INFEASIBLE and not solution.gradient_valid and solution.residual > 0.1
    low, high = bounds()
    steps = in_heading(np.asarray(solution.value.inputs), headings)
    assert np.all(steps > low - 1e-6) and np.all(steps < high + 1e-6)
    np.testing.assert_allclose(steps[0, 1], -0.2, atol=1e-6)  # all it can do is step far towards the fall
    assert np.abs(solution.value.states[:, :, 1]).max() < 1.0


def test_contradicting_bounds_are_reported(x64):
    """Property: traced bounds that leave no room are INFEASIBLE; the plan lies between them."""
    footsteps, state, headings = rough_walk(0, noise=0.0, kick=0.0)
    solution = solve(footsteps, state, 1.0, headings, (0.2, 0.1, 0.08))
    assert solution.status == Status.INFEASIBLE and np.isfinite(solution.residual)
    lateral = in_heading(np.asarray(solution.value.inputs), headings)[:, 1]
    np.testing.assert_allclose(np.abs(lateral), 0.09, atol=6e-4)


def test_failed_search_stays_within_reach(x64, monkeypatch):
    """Oracle: the bounds and the step map. Without rounds the plan is approximate, flagged, and within reach."""
    monkeypatch.setattr(box_qp, "_ROUNDS", 0)
    footsteps, state, headings = rough_walk(1)
    solution = jax.jit(lambda *x: solve_bounded_step_mpc(*x))(footsteps, state, 1.0, headings)
    assert solution.status == Status.MAX_ITERATIONS and not solution.gradient_valid
    low, high = bounds()
    steps = in_heading(np.asarray(solution.value.inputs), headings)
    assert np.all(steps > low - 1e-9) and np.all(steps < high + 1e-9)
    a, b = step_map(BRUCE)
    x = np.asarray(solution.value.states)
    np.testing.assert_allclose(x[1:], x[:-1] @ a.T + solution.value.inputs[1:, :, None] * b, atol=1e-9)


def test_walks_on_without_crossing_legs(x64):
    """Oracle: NumPy simulation of 60 steps with kicks of 8 cm/s; the COM stays bounded, every step within reach."""
    rng = np.random.default_rng(2)
    footsteps, state, headings = irregular_walk(80, noise=0.0, kick=0.0, turn=0.05)
    a, b = step_map(BRUCE)
    stance, tight = 1.0, 0
    for k in range(60):
        state = state + 0.08 * rng.normal(size=(2, 1)) * np.array([0, 0, 1])
        solution = solve(footsteps[k : k + HORIZON], state, stance, headings[k : k + HORIZON])
        assert solution.status == Status.CONVERGED
        step = np.asarray(solution.value.inputs[0])
        forward, left = in_heading(step[None], headings[k : k + 1])[0]
        assert abs(forward) < 0.2 + 1e-9 and 0.04 - 1e-9 < -stance * left < 0.2 + 1e-9
        tight += -stance * left < 0.04 + 1e-9
        state, stance = state @ a.T + step[:, None] * b, -stance
        assert np.abs(state[:, 1]).max() < 0.2
    assert tight > 0


def test_batch_equals_loop():
    """Property: a row of a batch equals the same problem alone."""
    batch = [np.stack(x).astype(np.float32) for x in zip(*(rough_walk(seed, kick=0.02) for seed in range(4)))]
    footsteps, states, headings = batch
    one, reach = np.float32(1), np.asarray(REACH, np.float32)
    both = jax.jit(jax.vmap(compiled, (0, 0, None, 0, None)))(footsteps, states, one, headings, reach)
    for i in range(4):
        single = solve(footsteps[i], states[i], one, headings[i])
        assert single.status == both.status[i]
        np.testing.assert_allclose(both.value.footsteps[i], single.value.footsteps, atol=1e-5)


@pytest.mark.parametrize("where", ["footsteps", "headings", "reach", "stance"])
def test_bad_values_are_reported(where):
    """Property: unusable numbers give NON_FINITE and a finite plan."""
    footsteps, state, headings = (x.astype(np.float32) for x in rough_walk(0))
    reach, stance = np.array([0.2, 0.04, 0.2], np.float32), np.float32(1)
    if where == "footsteps":
        footsteps[2] = np.inf
    elif where == "headings":
        headings[0] = np.nan
    elif where == "reach":
        reach[1] = np.nan
    else:
        stance = np.float32(0)
    solution = solve(footsteps, state, stance, headings, reach)
    assert solution.status == Status.NON_FINITE
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(solution.value))


def test_wrong_heading_shape(unchecked_types):
    """The message gives the wanted shape."""
    footsteps, state, headings = rough_walk(0)
    with pytest.raises(InputError, match="headings have shape"):
        solve_bounded_step_mpc(footsteps, state, 1.0, headings[:-1])


def test_a_bound_that_just_touches_has_no_derivative(x64):
    """Property: with the reach at the longest step of the free optimum the margin is zero, beside it it is not."""
    footsteps, state, headings = rough_walk(3, noise=0.02, kick=0.0)
    free = solve(footsteps, state, 1.0, headings, (1.0, -1.0, 1.0))
    longest = np.max(np.abs(in_heading(np.asarray(free.value.inputs), headings)[:, 0]))
    for factor in (0.97, 1.0, 1.1):
        solution = solve(footsteps, state, 1.0, headings, (factor * longest, -1.0, 1.0))
        assert solution.status == Status.CONVERGED
        assert bool(solution.gradient_valid) == (factor != 1)
        if factor >= 1:
            np.testing.assert_allclose(solution.margin, (factor - 1) / factor, atol=1e-7)
