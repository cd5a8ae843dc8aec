"""H-LIP dynamics, orbits and gains against NumPy/SciPy re-derivations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

from iwalker_jax.errors import InputError
from iwalker_jax.optimization.steps import hlip

CASES = [
    hlip.HlipParameters(),
    hlip.HlipParameters(com_height=0.8, double_support_time=0.05),
    hlip.HlipParameters(com_height=0.3, single_support_time=0.4, double_support_time=0.2),
    hlip.HlipParameters(com_height=1.0, single_support_time=0.08),
]
cases = pytest.mark.parametrize("parameters", CASES, ids=range(len(CASES)))


@cases
def test_step_map_equals_integrated_pendulum(x64, parameters):
    """Oracle: SciPy integrates the drift of double support, then c'' = lambda^2 (c - foot)."""
    com, position, velocity, step = 0.3, 0.07, -0.4, 0.12
    foot = com - position + step
    start = com + velocity * parameters.double_support_time
    square = parameters.gravity / parameters.com_height
    run = solve_ivp(
        lambda _, y: [y[1], square * (y[0] - foot)],
        (0, parameters.single_support_time),
        [start, velocity],
        rtol=1e-11,
        atol=1e-12,
    )
    end, speed = run.y[:, -1]
    state, column = hlip.step_matrices(parameters)
    got = state @ jnp.array([com, position, velocity]) + column * step
    np.testing.assert_allclose(got, [end, end - foot, speed], atol=1e-8)


@cases
def test_modes_are_eigenvectors(x64, parameters):
    """Oracle: numpy.linalg.eigvals, and the modal form q' = pole (q - u) applied to the step map."""
    state, column = (np.asarray(x) for x in hlip.step_matrices(parameters))
    pole, divergent, convergent = hlip.modes(parameters)
    np.testing.assert_allclose(sorted([1 / pole, pole]), sorted(np.linalg.eigvals(state[1:, 1:])), rtol=1e-9)
    for value, lead in ((pole, divergent), (1 / pole, convergent)):
        row = np.array([1.0, float(lead)])
        np.testing.assert_allclose(row @ state[1:, 1:], value * row, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(row @ column[1:], -value, rtol=1e-9)
    assert divergent > 0 > convergent
    np.testing.assert_allclose(hlip.divergent_component(parameters, 0.1, 0.2), 0.1 + divergent * 0.2)


def test_divergent_lead_without_double_support(x64):
    """Oracle: the instantaneous capture point, p + v / lambda."""
    parameters = hlip.HlipParameters()
    np.testing.assert_allclose(hlip.modes(parameters).divergent_lead, np.sqrt(0.365 / 9.81), rtol=1e-12)
    np.testing.assert_allclose(hlip.modes(parameters).pole, np.exp(0.24 * np.sqrt(9.81 / 0.365)), rtol=1e-12)


@cases
def test_orbits_are_fixed_points(x64, parameters):
    """Oracle: the step map itself; P1 returns after one step, P2 after two, and P1 is P2 with equal steps."""
    full, column = (np.asarray(x) for x in hlip.step_matrices(parameters))
    state, column = full[1:, 1:], column[1:]
    position, velocity, step = (float(x) for x in hlip.orbit_p1(parameters, jnp.asarray(0.4)))
    orbit = np.array([position, velocity])
    np.testing.assert_allclose(step, 0.4 * parameters.step_time)
    np.testing.assert_allclose(state @ orbit + column * step, orbit, atol=1e-12)
    np.testing.assert_allclose(hlip.orbit_p2(parameters, step, step), orbit, atol=1e-12)
    left, right = 0.13, -0.07
    first = np.array(hlip.orbit_p2(parameters, left, right))
    second = np.array(hlip.orbit_p2(parameters, right, left))
    np.testing.assert_allclose(state @ first + column * left, second, atol=1e-12)
    np.testing.assert_allclose(state @ second + column * right, first, atol=1e-12)


@cases
def test_deadbeat_gain_is_nilpotent(x64, parameters):
    """Oracle: (A + B K)^2 = 0 on (p, v)."""
    state, column = (np.asarray(x) for x in hlip.step_matrices(parameters))
    closed = state[1:, 1:] + np.outer(column[1:], hlip.deadbeat_gain(parameters))
    assert np.abs(closed).max() > 1e-3
    np.testing.assert_allclose(closed @ closed, 0, atol=1e-11)


@cases
def test_lqr_gain_equals_riccati(x64, parameters):
    """Oracle: scipy.linalg.solve_discrete_are."""
    full, column = (np.asarray(x) for x in hlip.step_matrices(parameters))
    state, column = full[1:, 1:], column[1:, None]
    for weights, effort in (([1.0, 0.2], 0.5), ([100.0, 0.0], 1e-3), ([1e-3, 1e-3], 10.0)):
        cost = solve_discrete_are(state, column, np.diag(weights), [[effort]])
        expected = -np.linalg.solve(effort + column.T @ cost @ column, column.T @ cost @ state)[0]
        np.testing.assert_allclose(hlip.lqr_gain(parameters, jnp.array(weights), effort), expected, rtol=1e-7)


def test_gradients_with_respect_to_physics(x64):
    """Oracle: central differences of every constant, in forward and reverse mode."""

    def everything(values):
        parameters = hlip.HlipParameters(*values)
        state, column = hlip.step_matrices(parameters)
        parts = [
            state,
            column,
            *hlip.modes(parameters),
            *hlip.orbit_p1(parameters, jnp.asarray(0.3)),
            *hlip.orbit_p2(parameters, 0.1, -0.05),
            hlip.deadbeat_gain(parameters),
            hlip.lqr_gain(parameters, jnp.array([1.0, 0.2]), jnp.asarray(0.1)),
        ]
        return jnp.concatenate([jnp.ravel(part) for part in parts])

    point = np.array([0.365, 0.24, 0.03, 9.81])
    forward, reverse = jax.jacfwd(everything)(point), jax.jacrev(everything)(point)
    step = 1e-6
    central = [(everything(point + step * e) - everything(point - step * e)) / (2 * step) for e in np.eye(4)]
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(forward, np.stack(central, axis=1), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("com_height", -1.0),
        ("single_support_time", 0.0),
        ("double_support_time", float("nan")),
        ("gravity", 0),
    ],
)
def test_bad_constants_are_refused(name, value):
    """The message names the constant."""
    with pytest.raises(InputError, match=name):
        hlip.HlipParameters(**{name: value})
