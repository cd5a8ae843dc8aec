"""Step MPC against dense KKT systems, general QP solvers, closed-loop simulation and finite differences."""

from functools import partial

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
    divergent_component,
    orbit_p2,
    solve_bounded_step_mpc,
    solve_step_mpc,
)

BRUCE = HlipParameters()
PHYSICS = [BRUCE, HlipParameters(0.8, 0.24, 0.1), HlipParameters(0.3, 0.5, 0.05), HlipParameters(1.2, 0.1, 0.3)]
WEIGHTS = [StepMpcWeights(), StepMpcWeights(100.0, 3.0, 5.0, 1.0, 10.0)]
solve = jax.jit(solve_step_mpc, static_argnames="gradient")


def walk(horizon, seed=0, noise=0.02):
    """Irregular footsteps along an arc, and a disturbed state on the left foot."""
    return irregular_walk(horizon, seed, noise, noise)[:2]


def dense_solution(footsteps, state, parameters, weights):
    """NumPy's dense solve of the whole KKT system with the states kept as variables."""
    qp = build_step_qp(footsteps, state, parameters, weights)
    rows = len(qp.drift)
    matrix = np.block([[qp.hessian, qp.dynamics.T], [qp.dynamics, np.zeros((rows, rows))]])
    z = np.linalg.solve(matrix, np.concatenate([-qp.linear, qp.drift]))[: len(qp.linear)]
    return *qp.unpack(z), qp.cost(z)


@pytest.mark.parametrize("horizon", [2, 3, 7, 20, 50])
def test_equals_dense_kkt_solve(x64, horizon):
    """Oracle: NumPy's dense KKT solve, for several pendulums and weights, to 1e-6 and far better."""
    for parameters in PHYSICS:
        for weights in WEIGHTS:
            footsteps, state = walk(horizon)
            solution = solve(footsteps, state, parameters, weights)
            for got, expected in zip(solution.value, dense_solution(footsteps, state, parameters, weights)):
                np.testing.assert_allclose(got, expected, atol=1e-9)
            assert solution.status == Status.CONVERGED and solution.gradient_valid


def test_single_step_equals_brute_force(x64):
    """Oracle: NumPy polyfit of the one-variable cost written out (the reference of one step is standing)."""
    footsteps, state = walk(1)
    solution = solve(footsteps, state)
    a, b = step_map(BRUCE)
    weights, lead = StepMpcWeights(), np.sqrt(BRUCE.com_height / BRUCE.gravity)
    for plane in range(2):

        def cost(u, plane=plane):
            c, p, v = a @ state[plane] + b * u
            return (
                weights.footstep * (c - p - footsteps[0, plane]) ** 2
                + weights.orbit_position * p**2
                + weights.orbit_velocity * v**2
                + weights.terminal * (p + lead * v) ** 2
            )

        square, slope, _ = np.polyfit([-0.1, 0.0, 0.1], [cost(u) for u in (-0.1, 0.0, 0.1)], 2)
        np.testing.assert_allclose(solution.value.inputs[0, plane], -slope / (2 * square), atol=1e-9)


def test_equals_general_solvers(x64):
    """Oracles: OSQP and Clarabel on the same QP."""
    footsteps, state = walk(12)
    qp = build_step_qp(footsteps, state, BRUCE, WEIGHTS[1])
    h, e = sparse.csc_matrix(np.triu(qp.hessian)), sparse.csc_matrix(qp.dynamics)
    first = osqp.OSQP()
    first.setup(h, qp.linear, e, qp.drift, qp.drift, verbose=False, eps_abs=1e-10, eps_rel=1e-10, max_iter=100000)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    cones = [clarabel.ZeroConeT(len(qp.drift))]
    second = clarabel.DefaultSolver(h, qp.linear, e, qp.drift, cones, settings)
    value = solve(footsteps, state, BRUCE, WEIGHTS[1]).value
    for z in (np.asarray(first.solve(raise_error=False).x), np.asarray(second.solve().x)):
        np.testing.assert_allclose(value.footsteps, qp.unpack(z)[0], atol=1e-6)
        np.testing.assert_allclose(value.states, qp.unpack(z)[1], atol=1e-5)


@pytest.mark.parametrize("horizon", [4, 20, 50])
def test_float32_accuracy(horizon):
    """Oracle: NumPy's dense KKT solve in float64. Footsteps agree to 5 um, velocities to 50 um/s."""
    for parameters in PHYSICS:
        footsteps, state = walk(horizon)
        solution = solve(footsteps.astype(np.float32), state.astype(np.float32), parameters)
        expected = dense_solution(footsteps, state, parameters, StepMpcWeights())
        assert solution.value.footsteps.dtype == jnp.float32
        np.testing.assert_allclose(solution.value.footsteps, expected[0], atol=5e-6)
        np.testing.assert_allclose(solution.value.states, expected[1], atol=5e-5)
        assert solution.status == Status.CONVERGED


def test_superposition(x64):
    """Property: the plan is linear in (footsteps, initial state)."""
    (f1, x1), (f2, x2) = walk(20, 1), walk(20, 2)
    both = solve(2 * f1 - 3 * f2, 2 * x1 - 3 * x2).value
    one, two = solve(f1, x1).value, solve(f2, x2).value
    for name in ("footsteps", "states", "inputs"):
        expected = 2 * getattr(one, name) - 3 * getattr(two, name)
        np.testing.assert_allclose(getattr(both, name), expected, atol=1e-11)


def test_symmetries(x64):
    """Properties: moving, turning and mirroring the problem moves, turns and mirrors the plan."""
    footsteps, state = walk(20)
    plan = solve(footsteps, state).value
    cos, sin = np.cos(0.7), np.sin(0.7)
    for matrix in (np.array([[cos, -sin], [sin, cos]]), np.diag([1.0, -1.0])):
        other = solve(footsteps @ matrix.T, matrix @ state).value
        np.testing.assert_allclose(other.footsteps, plan.footsteps @ matrix.T, atol=1e-12)
        np.testing.assert_allclose(other.states, np.einsum("ij,njk->nik", matrix, plan.states), atol=1e-12)
        np.testing.assert_allclose(other.cost, plan.cost, rtol=1e-9)
    shift = np.array([3.0, -2.0])
    moved = solve(footsteps + shift, state + np.outer(shift, [1, 0, 0])).value
    np.testing.assert_allclose(moved.footsteps, plan.footsteps + shift, atol=1e-12)
    np.testing.assert_allclose(moved.inputs, plan.inputs, atol=1e-12)


def test_regular_gait_is_kept(x64):
    """Oracle: the period-two orbit; a robot on it with footsteps to match needs no correction at all."""
    horizon = 10
    steps = np.stack([np.full(horizon, 0.09), np.where(np.arange(horizon) % 2 == 0, -0.08, 0.08)], axis=1)
    state = np.stack([[0.0, *orbit_p2(BRUCE, steps[0, i], steps[1, i])] for i in range(2)])
    start = state[:, 0] - state[:, 1]
    solution = solve(start + np.cumsum(steps, axis=0), state)
    np.testing.assert_allclose(solution.value.inputs, steps, atol=1e-9)
    position, velocity = orbit_p2(BRUCE, np.roll(steps, -1, axis=0), steps)
    np.testing.assert_allclose(solution.value.states[:, :, 1], position, atol=1e-9)
    np.testing.assert_allclose(solution.value.states[:, :, 2], velocity, atol=1e-9)
    assert solution.value.cost < 1e-15


def receding_horizon(weights, steps, horizon, disturbance):
    """Largest |p| and RMS tracking error of the MPC's first step applied again and again (NumPy pendulum)."""
    footsteps, state = walk(steps + horizon, noise=0.0)
    rng = np.random.default_rng(3)
    a, b = step_map(BRUCE)
    largest, errors = 0.0, []
    for k in range(steps):
        state = state + disturbance * rng.normal(size=(2, 1)) * np.array([0, 0, 1])
        step = np.asarray(solve(footsteps[k : k + horizon], state, BRUCE, weights).value.inputs[0])
        state = state @ a.T + step[:, None] * b
        errors.append(state[:, 0] - state[:, 1] - footsteps[k])
        largest = max(largest, np.abs(state[:, 1]).max())
    return largest, np.sqrt(np.mean(np.square(errors[5:]).sum(1)))


def test_com_stays_bounded_in_closed_loop(x64):
    """Oracle: NumPy simulation of 100 steps, undisturbed and with velocity kicks of 3 cm/s before each step."""
    largest, error = receding_horizon(StepMpcWeights(), 100, 8, 0.0)
    assert largest < 0.1 and error < 5e-4
    largest, error = receding_horizon(StepMpcWeights(), 100, 8, 0.03)
    assert largest < 0.12 and error < 0.02


def test_open_loop_plan_is_bounded_and_published_weights_run_away(x64):
    """Oracle: the step map applied to the planned inputs; only footsteps and inputs in the cost lose the COM."""
    footsteps, state = walk(20)
    a, b = step_map(BRUCE)
    ours, published = (solve(footsteps, state, BRUCE, w).value for w in (WEIGHTS[0], StepMpcWeights.published()))
    for plan, low, high in ((ours, 0.0, 0.12), (published, 1e3, np.inf)):
        x = np.concatenate([state[None], plan.states])
        np.testing.assert_allclose(x[1:], x[:-1] @ a.T + plan.inputs[:, :, None] * b, rtol=1e-9, atol=1e-9)
        assert low <= np.abs(plan.states[:, :, 1]).max() < high
    free = solve(footsteps, state * np.array([1.0, 1.0, 5.0]), BRUCE, StepMpcWeights.published()).value
    np.testing.assert_allclose(free.footsteps, published.footsteps, atol=1e-9)
    assert np.abs(divergent_component(BRUCE, ours.states[..., 1], ours.states[..., 2])).max() < 0.2


def scalar_of(values, gradient):
    """A scalar that depends on every output, from (footsteps, state, physics, weights)."""
    footsteps, state, physics, factors = values
    solution = solve_step_mpc(footsteps, state, HlipParameters(*physics), StepMpcWeights(*factors), gradient)
    plan = solution.value
    rng = np.random.default_rng(5)
    parts = [jnp.sum(rng.normal(size=x.shape) * x) for x in (plan.footsteps, plan.states, plan.inputs)]
    return sum(parts) + 0.3 * plan.cost


def test_gradients_of_every_input(x64):
    """Oracle: central differences; forward and reverse mode, implicit and unrolled, all inputs and constants."""
    physics, factors = np.array([0.365, 0.24, 0.03, 9.81]), np.array([100.0, 3.0, 50.0, 2.0, 30.0])
    flat, unravel = ravel_pytree((*walk(6), physics, factors))
    value = jax.jit(lambda x: scalar_of(unravel(x), "implicit"))
    step = 1e-5 * np.maximum(np.abs(flat), 0.1)
    central = [(value(flat + h * e) - value(flat - h * e)) / (2 * h) for h, e in zip(step, np.eye(flat.size))]
    for gradient in ("implicit", "unrolled"):
        fun = partial(lambda x, mode: scalar_of(unravel(x), mode), mode=gradient)
        np.testing.assert_allclose(jax.jit(jax.jacrev(fun))(flat), central, rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(jax.jit(jax.jacfwd(fun))(flat), central, rtol=1e-5, atol=1e-7)
    stopped = jax.jit(jax.grad(lambda x: scalar_of(unravel(x), "stopped")))(flat)
    np.testing.assert_array_equal(stopped, 0)


def test_batch_equals_loop():
    """Property: a row of a batch equals the same problem alone, in value and in gradient."""
    batch = [walk(20, seed) for seed in range(4)]
    footsteps, states = (np.stack(x).astype(np.float32) for x in zip(*batch))

    def loss(f, x):
        return jnp.sum((solve_step_mpc(f, x).value.footsteps - f) ** 2)

    both = jax.jit(jax.vmap(jax.value_and_grad(loss, (0, 1))))(footsteps, states)
    single = jax.jit(jax.value_and_grad(loss, (0, 1)))
    for i in range(4):
        jax.tree.map(
            lambda a, b, i=i: np.testing.assert_allclose(a[i], b, rtol=1e-3, atol=1e-6),
            both,
            single(footsteps[i], states[i]),
        )


@pytest.mark.parametrize("where", ["footsteps", "state", "physics", "weights", "unphysical", "overflow"])
def test_bad_values_are_reported(where):
    """Property: NaN and unphysical input give NON_FINITE, a finite value and finite gradients."""
    footsteps, state = (x.astype(np.float32) for x in walk(6))
    physics, factors = np.array([0.365, 0.24, 0.0, 9.81], np.float32), np.array([100, 0, 100, 4, 100], np.float32)
    if where == "footsteps":
        footsteps[3, 1] = np.nan
    elif where == "state":
        state[0, 2] = np.inf
    elif where == "physics":
        physics[0] = np.nan
    elif where == "weights":
        factors[1] = np.nan
    elif where == "unphysical":
        physics[0] = -1.0
    else:
        footsteps[:] = 3e38

    def run(values):
        f, x, p, w = values
        solution = solve_step_mpc(f, x, HlipParameters(*p), StepMpcWeights(*w))
        return jnp.sum(solution.value.footsteps), solution

    (_, solution), slopes = jax.jit(jax.value_and_grad(run, has_aux=True))((footsteps, state, physics, factors))
    assert solution.status == Status.NON_FINITE and not solution.gradient_valid
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(solution.value))
    if where != "overflow":
        assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(slopes))


def test_host_errors(unchecked_types):
    """Wrong shapes, modes and weights raise one clear sentence."""
    footsteps, state = walk(6)
    with pytest.raises(InputError, match="footsteps have shape"):
        solve_step_mpc(footsteps[:, :1], state)
    with pytest.raises(InputError, match="initial_state has shape"):
        solve_step_mpc(footsteps, state[0])
    with pytest.raises(InputError, match="gradient"):
        solve_step_mpc(footsteps, state, gradient="exact")
    with pytest.raises(InputError, match="terminal"):
        StepMpcWeights(terminal=-1.0)
    with pytest.raises(InputError, match="both 0"):
        StepMpcWeights(footstep=0.0)


def test_a_pendulum_that_runs_away_too_fast_is_refused(unchecked_types):
    """Plain constants are refused in a sentence that names the growth; traced ones are reported."""
    footsteps, state = (x.astype(np.float32) for x in walk(6))
    for parameters in (HlipParameters(single_support_time=2.0), HlipParameters(com_height=0.01)):
        with pytest.raises(InputError, match="times in a step"):
            solve_step_mpc(footsteps, state, parameters)
        with pytest.raises(InputError, match="times in a step"):
            solve_bounded_step_mpc(footsteps, state, np.float32(1.0), parameters=parameters)
        traced = jax.jit(solve_step_mpc)(footsteps, state, jax.tree.map(jnp.float32, parameters))
        assert traced.status == Status.NON_FINITE and np.all(np.isfinite(traced.value.footsteps))
