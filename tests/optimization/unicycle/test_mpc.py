"""The unicycle solver against IPOPT, finite differences and its own symmetries."""

import casadi
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import (
    Status,
    UnicycleParameters,
    initial_state_from_reference,
    solve_unicycle,
    unicycle_rollout,
)

FREE = UnicycleParameters()
_solve = jax.jit(solve_unicycle, static_argnums=(2, 3))


def _arc_reference(turn: float, length: float = 5.0, points: int = 100) -> np.ndarray:
    angle = np.linspace(0.0, turn, points)
    steps = np.stack([np.cos(angle), np.sin(angle)], axis=1) * length / points
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])


def _wavy_reference(seed: int, points: int = 100) -> np.ndarray:
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-1, 1) + np.convolve(np.cumsum(rng.normal(size=points) * 0.12), np.ones(7) / 7, "same")
    return _from_headings(heading)


def _from_headings(heading: np.ndarray, step: float = 0.05) -> np.ndarray:
    steps = step * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])


def _zigzag_reference(points: int = 100) -> np.ndarray:
    along = np.linspace(0.0, 6.0, points)
    return np.stack([along, 0.6 * (2 * np.abs(2 * ((along * 0.4) % 1) - 1) - 1) - 0.6], axis=1)


def _ipopt_cost(reference, state, parameters: UnicycleParameters, guess) -> float:
    """Optimal cost of the same problem, stated over states and controls and solved by IPOPT from a given motion."""
    n = len(reference)
    x, u = casadi.MX.sym("x", 4, n), casadi.MX.sym("u", 2, n - 1)
    moved = casadi.vertcat(
        x[0, :-1] + parameters.dt * x[2, :-1] * casadi.cos(x[3, :-1]),
        x[1, :-1] + parameters.dt * x[2, :-1] * casadi.sin(x[3, :-1]),
        x[2, :-1] + parameters.dt * u[1, :],
        x[3, :-1] + parameters.dt * u[0, :],
    )
    cost = parameters.position_weight * casadi.sumsqr(x[:2, :] - reference.T)
    cost += parameters.turn_weight * casadi.sumsqr(u[0, :]) + parameters.acceleration_weight * casadi.sumsqr(u[1, :])
    motion = casadi.vertcat(x[:, 0] - np.asarray(state), casadi.vec(x[:, 1:] - moved))
    problem = {"x": casadi.vertcat(casadi.vec(x), casadi.vec(u)), "f": cost, "g": motion}
    quiet = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-9}
    solver = casadi.nlpsol("unicycle", "ipopt", problem, quiet)

    def limit(bound):
        return np.inf if bound is None else bound

    speed = np.full(n, limit(parameters.speed_bound))
    speed[0] = np.inf
    states = np.stack([np.full(n, np.inf), np.full(n, np.inf), speed, np.full(n, np.inf)], axis=1)
    controls = np.tile([limit(parameters.turn_bound), limit(parameters.acceleration_bound)], (n - 1, 1))
    box = np.concatenate([states.ravel(), controls.ravel()])
    start = np.concatenate([np.asarray(guess.states).ravel(), np.asarray(guess.controls).ravel()])
    answer = solver(x0=start, lbx=-box, ubx=box, lbg=0, ubg=0)
    assert solver.stats()["success"]
    return float(answer["f"])


def _zero_guess(state, parameters, points=100):
    controls = jnp.zeros((points - 1, 2))

    class Guess:
        pass

    Guess.controls, Guess.states = controls, unicycle_rollout(jnp.asarray(state, jnp.float32), controls, parameters.dt)
    return Guess


def _state(reference) -> jnp.ndarray:
    return initial_state_from_reference(jnp.asarray(reference, jnp.float32))


@pytest.mark.parametrize(
    "reference",
    [_wavy_reference(0), _wavy_reference(1), _zigzag_reference(), _arc_reference(2.5 * np.pi)],
    ids=["wavy", "wavy2", "zigzag", "circle"],
)
def test_cost_is_no_worse_than_ipopt(reference):
    """Oracle: IPOPT from zero controls; float32."""
    state = _state(reference)
    solution = _solve(jnp.asarray(reference, jnp.float32), state, FREE)
    oracle = _ipopt_cost(reference, state, FREE, _zero_guess(state, FREE))
    assert solution.status == Status.CONVERGED
    assert solution.gradient_valid
    assert float(solution.value.cost) <= oracle * 1.001


@pytest.mark.parametrize(
    "parameters",
    [
        UnicycleParameters.published(),
        UnicycleParameters(turn_bound=0.01),
        UnicycleParameters(acceleration_bound=5e-4),
        UnicycleParameters(speed_bound=0.045),
        UnicycleParameters(turn_bound=0.02, acceleration_bound=5e-4, speed_bound=0.052),
    ],
    ids=["published", "turn", "acceleration", "speed", "all"],
)
def test_bounded_cost_equals_ipopt(parameters, x64):
    """Oracle: IPOPT with the bounds, started from the solver's own plan, cannot improve it; every bound is kept."""
    reference = _wavy_reference(3)
    state = initial_state_from_reference(jnp.asarray(reference)).at[2].set(0.04)
    solution = _solve(jnp.asarray(reference), state, parameters)
    plan = solution.value
    oracle = _ipopt_cost(reference, state, parameters, plan)
    assert solution.status == Status.CONVERGED
    assert float(plan.cost) == pytest.approx(oracle, rel=1e-5)
    used = 0
    for bound, values in (
        (parameters.turn_bound, plan.controls[:, 0]),
        (parameters.acceleration_bound, plan.controls[:, 1]),
        (parameters.speed_bound, plan.states[1:, 2]),
    ):
        if bound is not None:
            assert np.max(np.abs(values)) <= bound * (1 + 1e-9)
            used += np.sum(np.abs(values) >= bound * (1 - 1e-6))
    assert used > 0


def test_plan_obeys_the_motion_and_starts_where_told():
    """Oracle: a NumPy loop over the four difference equations."""
    reference = _wavy_reference(4) + 3.0
    state = np.array([2.9, 3.1, 0.03, 0.4], np.float32)
    plan = _solve(jnp.asarray(reference, jnp.float32), jnp.asarray(state), FREE).value
    x = state.astype(np.float64)
    for k, (omega, a) in enumerate(np.asarray(plan.controls, np.float64)):
        np.testing.assert_allclose(plan.states[k], x, atol=2e-5)
        x = x + np.array([x[2] * np.cos(x[3]), x[2] * np.sin(x[3]), a, omega])
    np.testing.assert_allclose(plan.states[-1], x, atol=2e-5)
    np.testing.assert_array_equal(plan.path, plan.states[:, :2])


@pytest.mark.parametrize("mode", ["implicit", "unrolled"])
@pytest.mark.parametrize("parameters", [{}, {"turn_bound": 0.03, "acceleration_bound": 0.001, "speed_bound": 0.05}])
def test_derivatives_match_finite_differences(mode, parameters, x64):
    """Oracle: central differences in every input; forward mode equals reverse mode."""
    parameters = UnicycleParameters(tolerance=1e-9, **parameters)
    reference = jnp.asarray(_wavy_reference(5))
    state = jnp.array([0.05, -0.1, 0.045, 0.2])
    weights = jnp.array([1.0, 1000.0, 5000.0])
    rng = np.random.default_rng(0)
    probe = jnp.asarray(rng.normal(size=(100, 4)))

    @jax.jit
    def loss(reference, state, weights):
        solution = solve_unicycle(reference, state, parameters, mode, weights)
        return jnp.sum(solution.value.states * probe) + solution.value.cost

    inputs = (reference, state, weights)
    reverse = jax.jit(jax.grad(loss, (0, 1, 2)))(*inputs)
    forward = jax.jit(lambda tangents: jax.jvp(loss, inputs, tangents)[1])
    assert _solve(*inputs[:2], parameters, mode).gradient_valid
    for index, scale in enumerate((1e-5, 1e-5, 1e-3)):  # larger steps than the solver's own tolerance
        direction = jnp.asarray(rng.normal(size=inputs[index].shape))
        ahead, behind = (
            [leaf + sign * scale * direction if k == index else leaf for k, leaf in enumerate(inputs)]
            for sign in (1, -1)
        )
        difference = (loss(*ahead) - loss(*behind)) / (2 * scale)
        tangents = tuple(direction if k == index else jnp.zeros_like(leaf) for k, leaf in enumerate(inputs))
        assert float(jnp.sum(reverse[index] * direction)) == pytest.approx(float(difference), rel=1e-5)
        assert float(forward(tangents)) == pytest.approx(float(difference), rel=1e-5)


def test_stopped_mode_has_no_derivative():
    """Oracle: zero."""
    reference = jnp.asarray(_wavy_reference(6), jnp.float32)
    state = _state(reference)
    gradient = jax.grad(lambda r: jnp.sum(solve_unicycle(r, state, FREE, "stopped").value.path))(reference)
    np.testing.assert_array_equal(gradient, 0.0)


def test_unconverged_solve_is_flagged():
    """One iteration on a hard reference: the status, the residual and the gradient flag say so."""
    reference = jnp.asarray(_zigzag_reference(), jnp.float32)
    hasty = UnicycleParameters(max_iterations=1, tolerance=1e-5)
    solution = _solve(reference, _state(reference).at[3].add(1.0), hasty)
    assert solution.status == Status.MAX_ITERATIONS
    assert not solution.gradient_valid
    assert solution.residual > hasty.tolerance


def test_rotation_and_mirror_symmetry(x64):
    """Rotating or mirroring the reference and the initial state does the same to the plan."""
    parameters = UnicycleParameters(tolerance=1e-9)

    def solve(reference, state):
        return _solve(reference, state, parameters).value

    reference, state = jnp.asarray(_wavy_reference(7)), jnp.array([0.1, -0.05, 0.05, 0.3])
    plan = solve(reference, state)
    angle = 2.0
    turn = jnp.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = solve(reference @ turn.T, jnp.concatenate([turn @ state[:2], state[2:] + jnp.array([0.0, angle])]))
    np.testing.assert_allclose(turned.path, plan.path @ turn.T, atol=1e-8)
    np.testing.assert_allclose(turned.controls, plan.controls, atol=1e-9)
    flip = jnp.array([1.0, -1.0])
    mirrored = solve(reference * flip, state * jnp.array([1.0, -1.0, 1.0, -1.0]))
    np.testing.assert_allclose(mirrored.path, plan.path * flip, atol=1e-8)
    np.testing.assert_allclose(mirrored.controls, plan.controls * jnp.array([-1.0, 1.0]), atol=1e-9)


def test_a_point_abeam_in_double_precision():
    """Oracle: the same plan in single precision. Quadratic models of some starts break down on the way to a point
    1 m to the left of a robot at rest, which is neither an optimum nor a reason to give these starts up."""
    reference = np.tile([[0.0, 1.0]], (100, 1))
    single = _solve(jnp.asarray(reference, jnp.float32), jnp.zeros(4, jnp.float32), UnicycleParameters())
    with jax.enable_x64(True):
        state = jnp.zeros(4, jnp.float64)
        double = _solve(jnp.asarray(reference), state, UnicycleParameters())
        slope = jax.grad(lambda r: solve_unicycle(r, state).value.cost)(jnp.asarray(reference))
        assert int(double.status) == int(single.status) == Status.CONVERGED
        assert float(double.value.cost) == pytest.approx(float(single.value.cost), rel=1e-3)
        assert bool(jnp.isfinite(slope).all())


def test_two_turns_are_followed_without_wrapping():
    """A path of two full circles (720 degrees): the heading grows past 2 pi without a jump and the path is tracked."""
    reference = _arc_reference(4 * np.pi, length=120.0)
    solution = _solve(jnp.asarray(reference, jnp.float32), _state(reference), FREE)
    theta = np.asarray(solution.value.states[:, 3])
    assert solution.status == Status.CONVERGED
    assert theta[-1] - theta[0] > 2.5 * np.pi
    assert np.max(np.abs(np.diff(theta))) < 0.3


def test_batch_equals_loop_and_bad_rows_stay_alone():
    """vmap, nested vmap and a loop agree; a row of NaN or infinity is reported and does not touch its neighbours."""
    references = np.stack([_wavy_reference(k) for k in range(8)]).astype(np.float32)
    states = np.array(jax.vmap(initial_state_from_reference)(references))
    rows = jax.jit(jax.vmap(lambda r, s: solve_unicycle(r, s, FREE)))
    batch = rows(references, states)
    nested = jax.jit(jax.vmap(rows))(references.reshape(2, 4, 100, 2), states.reshape(2, 4, 4))
    np.testing.assert_allclose(nested.value.path.reshape(8, 100, 2), batch.value.path, atol=1e-5)
    for k in range(8):
        np.testing.assert_allclose(_solve(references[k], states[k], FREE).value.path, batch.value.path[k], atol=2e-4)
    references[2, 50], states[5, 2] = np.nan, np.inf
    broken = rows(references, states)
    assert [int(status) for status in broken.status[np.array([2, 5])]] == [Status.NON_FINITE] * 2
    assert not np.any(broken.gradient_valid[np.array([2, 5])])
    good = np.array([0, 1, 3, 4, 6, 7])
    np.testing.assert_array_equal(broken.value.path[good], batch.value.path[good])
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(broken.value))


@pytest.mark.parametrize("scale", [0.0, 1e-6, 1e2, 1e4, np.nan, np.inf])
def test_any_scale_gives_a_finite_plan(scale):
    """Zero-length, tiny, huge and non-finite references: the plan is finite, and honest about convergence."""
    with np.errstate(invalid="ignore"):
        reference = jnp.asarray(_wavy_reference(2) / 5.0 * scale, jnp.float32)
    solution = _solve(reference, initial_state_from_reference(reference), FREE)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(solution.value))
    if not np.isfinite(scale):
        assert solution.status == Status.NON_FINITE
    elif scale <= 1e2:
        assert solution.status == Status.CONVERGED


def test_too_fast_a_start_is_reported_and_slowed_down():
    """An initial speed far above the bound: infeasible, and the plan brakes as hard as it may."""
    parameters = UnicycleParameters(speed_bound=0.05, acceleration_bound=0.01)
    reference = jnp.asarray(_wavy_reference(3), jnp.float32)
    solution = _solve(reference, jnp.array([0.0, 0.0, 0.1, 0.0]), parameters)
    assert solution.status == Status.INFEASIBLE
    np.testing.assert_allclose(solution.value.states[:6, 2], [0.1, 0.09, 0.08, 0.07, 0.06, 0.05], atol=1e-6)
    assert np.max(solution.value.states[5:, 2]) <= 0.05 + 1e-6


def test_bad_shapes_and_modes_are_refused(unchecked_types):
    """One clear sentence each."""
    reference, state = jnp.zeros((100, 2)), jnp.zeros(4)
    with pytest.raises(InputError, match="reference must be"):
        solve_unicycle(reference[None], state)
    with pytest.raises(InputError, match="initial state must be"):
        solve_unicycle(reference, state[:3])
    with pytest.raises(InputError, match="weights must be"):
        solve_unicycle(reference, state, weights=jnp.ones(2))
    with pytest.raises(InputError, match="gradient mode"):
        solve_unicycle(reference, state, gradient="exact")


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_a_bound_that_just_touches_has_no_derivative(factor, x64):
    """Property: with the turn bound at the free optimum's largest turn rate the margin is zero, beside it it is not."""
    reference = jnp.asarray(_wavy_reference(3, points=20))
    state = jnp.zeros(4)
    largest = float(jnp.max(jnp.abs(_solve(reference, state, UnicycleParameters(tolerance=1e-8)).value.controls[:, 0])))
    plan = _solve(reference, state, UnicycleParameters(turn_bound=factor * largest, tolerance=1e-8))
    assert int(plan.status) == Status.CONVERGED
    assert bool(plan.gradient_valid) == (factor != 1)
    if factor >= 1:
        assert float(plan.margin) == pytest.approx(1 - 1 / factor, abs=1e-5)
