"""The Gauss-Newton iterations (`method="ilqr"`): their model, their optimum, its residual and its derivatives."""

from functools import partial

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
from iwalker_jax.optimization.unicycle.ddp import Trajectory, backward_sweep, uniform_grid
from iwalker_jax.optimization.unicycle.model import tracking_cost

POINTS = 40
_solve = jax.jit(solve_unicycle, static_argnums=(2, 3))


def _reference(seed: int) -> np.ndarray:
    """A path of 5 cm a point whose heading wanders by more than a right angle."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(-1, 1) + np.convolve(np.cumsum(rng.normal(size=POINTS) * 0.25), np.ones(7) / 7, "same")
    steps = 0.05 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps[:-1], axis=0)])


def _problem(seed: int) -> tuple[jax.Array, jax.Array]:
    reference = jnp.asarray(_reference(seed))
    return reference, initial_state_from_reference(reference).at[3].add(0.3)


def _objective(controls, reference, state, parameters):
    """The cost as a function of the controls alone."""
    states = unicycle_rollout(state, controls, parameters.dt)
    return tracking_cost(states, controls, reference, parameters.weights())


def _errors(controls, reference, state, parameters):
    """The terms whose squares sum up to the cost."""
    states = unicycle_rollout(state, controls, parameters.dt)
    weights = jnp.sqrt(parameters.weights())
    return jnp.concatenate([weights[0] * (states[:, :2] - reference).ravel(), (weights[1:] * controls).ravel()])


def _promise(gradient, hessian) -> float:
    """Decrease that a quadratic model of all controls promises."""
    slope = gradient.ravel()
    return float(0.5 * slope @ jnp.linalg.solve(hessian.reshape(slope.size, slope.size), slope))


def test_the_models_are_gauss_newtons_and_newtons(x64):
    """Oracle: the errors' Jacobian times itself, and the dense Hessian, of all controls by automatic differentiation.

    Dynamic programming weighs the motion's second derivatives by the slope after the controls' change, Newton by the
    slope before it; near the optimum that is the same.
    """
    reference, state = _problem(0)
    parameters = UnicycleParameters()
    # Near the optimum, where the problem itself is convex as well.
    controls = _solve(reference, state, parameters).value.controls
    controls = controls * (1 + 0.05 * jnp.sin(jnp.arange(POINTS - 1.0)))[:, None]
    given = (controls, reference, state, parameters)
    slope, jacobian = jax.grad(_objective)(*given), jax.jacobian(_errors)(*given).reshape(-1, controls.size)
    gauss, newton = _promise(slope, 2 * jacobian.T @ jacobian), _promise(slope, jax.hessian(_objective)(*given))
    assert gauss != pytest.approx(newton, rel=1e-2)
    motion = Trajectory(*unicycle_rollout(state, controls).T, *controls.T)
    undamped, weights = jnp.zeros(()), parameters.weights()
    sweep = (motion, tuple(reference.T), weights, undamped, 0.1, uniform_grid(motion.x, 1.0), parameters)
    assert float(backward_sweep(*sweep, second_order=False)[2]) == pytest.approx(gauss, rel=1e-8)
    assert float(backward_sweep(*sweep)[2]) == pytest.approx(newton, rel=1e-3)


@pytest.mark.parametrize("bounds", [{}, {"turn_bound": 0.05, "acceleration_bound": 5e-4, "speed_bound": 0.055}])
def test_both_methods_find_the_same_optimum(bounds, x64):
    """Oracles: the second-order method; without bounds also the cost's gradient in the controls, which vanishes."""
    parameters = {
        method: UnicycleParameters(method=method, tolerance=1e-8, max_iterations=200, **bounds)
        for method in ("ddp", "ilqr")
    }
    for seed in range(4):
        reference, state = _problem(seed)
        newton, gauss = (_solve(reference, state, given) for given in parameters.values())
        assert int(newton.status) == int(gauss.status) == Status.CONVERGED
        assert int(gauss.iterations) > 2
        assert bool(newton.gradient_valid) == bool(gauss.gradient_valid)
        assert float(gauss.margin) == pytest.approx(float(newton.margin), rel=1e-4, abs=1e-7)
        assert float(gauss.value.cost) == pytest.approx(float(newton.value.cost), rel=1e-10)
        np.testing.assert_allclose(gauss.value.states, newton.value.states, atol=1e-6)
        if not bounds:
            slope = jax.grad(_objective)(gauss.value.controls, reference, state, parameters["ilqr"])
            start = jax.grad(_objective)(jnp.zeros((POINTS - 1, 2)), reference, state, parameters["ilqr"])
            assert float(jnp.max(jnp.abs(slope))) <= 1e-6 * float(jnp.max(jnp.abs(start)))


@pytest.mark.parametrize("method", ["ddp", "ilqr"])
def test_the_residual_is_the_way_to_the_optimum(method, x64):
    """Oracle: the next Newton step's length from the dense Hessian by automatic differentiation.

    An iLQR that judged itself by its own model would call a plan solved that is still on its way.
    """
    parameters = UnicycleParameters(method=method, max_iterations=1, tolerance=1e-12)
    for seed in range(3):
        reference, state = _problem(seed)
        solution = _solve(reference, state, parameters)
        assert int(solution.status) == Status.MAX_ITERATIONS
        assert not solution.gradient_valid
        given = (solution.value.controls, reference, state, parameters)
        promised = _promise(jax.grad(_objective)(*given), jax.hessian(_objective)(*given))
        floor = POINTS * parameters.position_floor**2
        expected = np.sqrt(2 * promised / (float(solution.value.cost) + floor))
        assert float(solution.residual) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("mode", ["implicit", "unrolled"])
@pytest.mark.parametrize("bounds", [{}, {"turn_bound": 0.05, "acceleration_bound": 0.001, "speed_bound": 0.06}])
def test_derivatives_match_finite_differences(mode, bounds, x64):
    """Oracle: central differences, in every input, of the second-order method's optimum, which is found to rounding.

    Implicit derivatives need the true Hessian, which these iterations never make.
    """
    exact = UnicycleParameters(tolerance=1e-9, **bounds)
    gauss = UnicycleParameters(method="ilqr", tolerance=1e-7, max_iterations=100, unrolled_iterations=40, **bounds)
    reference, state = _problem(2)
    weights = jnp.array([1.0, 1000.0, 5000.0])
    rng = np.random.default_rng(0)
    probe = jnp.asarray(rng.normal(size=(POINTS, 4)))

    def loss(parameters, mode, *inputs):
        solution = solve_unicycle(*inputs[:2], parameters, mode, inputs[2])
        return jnp.sum(solution.value.states * probe) + solution.value.cost, solution.gradient_valid

    inputs = (reference, state, weights)
    reverse, valid = jax.jit(jax.grad(partial(loss, gauss, mode), (0, 1, 2), has_aux=True))(*inputs)
    assert valid
    value = jax.jit(lambda *inputs: loss(exact, "stopped", *inputs)[0])
    for index, scale in enumerate((1e-5, 1e-5, 1e-3)):
        direction = jnp.asarray(rng.normal(size=inputs[index].shape))
        ahead, behind = (
            value(*(leaf + sign * scale * direction if k == index else leaf for k, leaf in enumerate(inputs)))
            for sign in (1, -1)
        )
        difference = float((ahead - behind) / (2 * scale))
        assert float(jnp.sum(reverse[index] * direction)) == pytest.approx(difference, rel=1e-5)


def test_stopped_mode_has_no_derivative():
    """Oracle: zero."""
    reference = jnp.asarray(_reference(3), jnp.float32)
    parameters = UnicycleParameters(method="ilqr")
    state = initial_state_from_reference(reference)
    gradient = jax.grad(lambda r: jnp.sum(solve_unicycle(r, state, parameters, "stopped").value.path))(reference)
    np.testing.assert_array_equal(gradient, 0.0)


def test_a_batch_equals_a_loop_and_bad_rows_stay_alone():
    """Oracle: the rows solved one by one; a row of NaN is reported and does not touch its neighbours."""
    parameters = UnicycleParameters(method="ilqr")
    references = np.stack([_reference(k) for k in range(4)]).astype(np.float32)
    states = np.array(jax.vmap(initial_state_from_reference)(references))
    rows = jax.jit(jax.vmap(lambda r, s: solve_unicycle(r, s, parameters)))
    batch = rows(references, states)
    assert batch.status.tolist() == [Status.CONVERGED] * 4
    for k in range(4):
        alone = _solve(references[k], states[k], parameters)
        assert int(alone.iterations) == int(batch.iterations[k])
        np.testing.assert_allclose(alone.value.path, batch.value.path[k], atol=2e-4)
    references[1, 30] = np.nan
    broken = rows(references, states)
    assert int(broken.status[1]) == Status.NON_FINITE
    others = np.array([0, 2, 3])
    np.testing.assert_array_equal(broken.value.path[others], batch.value.path[others])


def test_an_unknown_method_is_refused():
    """One sentence that says what there is."""
    with pytest.raises(InputError, match=r"UnicycleParameters\.method is 'sqp'; choose one of ddp, ilqr"):
        UnicycleParameters(method="sqp")  # type: ignore[arg-type]
