"""Stepping feedback against the step MPC itself, SciPy's integrator and fixed points found by iteration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.control.stepping import choose_step, stepping_gains
from iwalker_jax.optimization import orbit_p1, pendulum_flow, solve_step_mpc, step_matrices

GAIT = GaitParameters()


@pytest.fixture(scope="module")
def gains():
    return stepping_gains(GAIT)


def choose(gains, wanted, position, velocity, side=1.0, remaining=0.24, expected=None, gait=GAIT):
    return choose_step(
        gait,
        gains,
        jnp.asarray(wanted),
        (jnp.asarray(position), jnp.asarray(velocity)),
        jnp.zeros((2, 2)) if expected is None else jnp.asarray(expected),
        jnp.zeros(()),
        jnp.asarray(side),
        jnp.asarray([0.0, 0.1 * side]),
        jnp.asarray(remaining),
    )


def orbit_footsteps(speed: float, side: float) -> np.ndarray:
    advance = speed * 0.24 * np.arange(1, GAIT.horizon + 1)
    return np.stack([advance, np.where(np.arange(GAIT.horizon) % 2 == 0, side * 0.1, 0.0)], axis=1)


def test_flow_is_the_pendulums(gains):
    solution = solve_ivp(
        lambda _, s: [s[1], float(gains.rate) ** 2 * s[0]], (0, 0.2), [0.02, -0.3], rtol=1e-10, atol=1e-12
    )
    position, velocity = pendulum_flow(gains.rate, jnp.asarray(0.02), jnp.asarray(-0.3), jnp.asarray(0.2))
    np.testing.assert_allclose([position, velocity], solution.y[:, -1], rtol=1e-5)


def test_gains_are_the_step_mpcs_first_step(gains):
    rng = np.random.default_rng(0)
    wanted = orbit_footsteps(0.2, 1.0) + rng.normal(0, 0.01, (GAIT.horizon, 2))
    position, velocity = rng.normal(0, 0.02, 2), rng.normal(0, 0.1, 2)
    state = np.stack([position, position, velocity], axis=1)  # the stance foot is the origin: c = p
    plan = solve_step_mpc(jnp.asarray(wanted), jnp.asarray(state), GAIT.hlip, GAIT.mpc).value
    by_gain = gains.wanted @ wanted + gains.state[0] * position + gains.state[1] * velocity
    np.testing.assert_allclose(by_gain, plan.footsteps[0], atol=1e-5)


def test_on_its_orbit_the_pendulum_takes_the_planned_step(gains):
    wanted = orbit_footsteps(0.2, 1.0)
    p, v, _ = (float(x) for x in orbit_p1(GAIT.hlip, jnp.asarray(0.2)))
    cosh, sinh = np.cosh(gains.rate * 0.24), np.sinh(gains.rate * 0.24)
    # The period-two lateral orbit of 10 cm steps: pre-impact p = u/2, v = sigma2 p.
    lateral = 0.05, 0.05 * float(gains.rate) * np.tanh(float(gains.rate) * 0.12)
    pre = np.array([[p, lateral[0]], [v, lateral[1]]])
    start = np.linalg.solve([[cosh, sinh / gains.rate], [gains.rate * sinh, cosh]], pre)
    choice = choose(gains, wanted, start[0], start[1])
    np.testing.assert_allclose(choice.footstep, wanted[0], atol=1e-4)
    np.testing.assert_allclose(choice.remaining, 0.24, atol=1e-6)


def test_learned_errors_shift_the_orbit_to_its_true_fixed_point(gains):
    transition = np.asarray(step_matrices(GAIT.hlip)[0])[1:, 1:]
    own, other = np.array([0.01, 0.05]), np.array([0.004, -0.03])
    # x_own = A x_other + w_own and x_other = A x_own + w_other, solved as one linear system.
    system = np.block([[np.eye(2), -transition], [-transition, np.eye(2)]])
    fixed = np.linalg.solve(system, np.concatenate([own, other]))
    np.testing.assert_allclose(gains.orbit_own @ own + gains.orbit_other @ other, fixed[:2], atol=1e-5)


def test_a_step_out_of_reach_is_taken_sooner_and_within_reach(gains):
    wanted = orbit_footsteps(0.0, 1.0)
    # Pushed outward over the right stance foot: the left foot would have to cross.
    choice = choose(gains, wanted, [0.0, 0.0], [0.0, -0.25])
    assert float(choice.unbounded[1]) < GAIT.reach.lateral_min
    assert float(choice.footstep[1]) >= GAIT.reach.lateral_min - 1e-6
    assert float(choice.remaining) < 0.2


@pytest.mark.parametrize("kick", [-0.6, 0.6])
def test_a_strong_push_is_caught_at_the_divergent_component_without_overshoot(gains, kick):
    """Stepping on the spot with the governor: the pendulum never moves against the push, and comes to rest."""
    transition, column = (np.asarray(x) for x in step_matrices(GAIT.hlip))
    inverse = np.linalg.inv(transition[1:, 1:])
    state, velocities = np.array([0.0, kick]), []
    for _ in range(8):
        wanted = np.zeros((GAIT.horizon, 2))
        wanted[:, 1] = np.where(np.arange(GAIT.horizon) % 2 == 0, 0.1, 0.0)
        start = inverse @ state  # so that flow over the whole step gives the pre-impact state
        choice = choose(gains, wanted, [start[0], 0.0], [start[1], 0.0])
        state = transition[1:, 1:] @ state + column[1:] * float(choice.footstep[0])
        velocities.append(state[1])
    along = np.sign(kick) * np.array(velocities)
    assert np.all(along > -1e-4)
    # The first step takes nine tenths of the push, and every second step nine tenths of what is left.
    assert along[0] < 0.15 * abs(kick)
    assert np.all(along[2:4] < 0.15 * along[:2]) and np.all(along[4:6] < 0.15 * along[2:4])


def test_choice_is_differentiable(x64):
    gains = stepping_gains(GAIT, np.float64)
    wanted = jnp.asarray(orbit_footsteps(0.2, 1.0))

    def footstep(velocity):
        return choose(gains, wanted, [0.01, 0.03], velocity).footstep

    velocity = jnp.asarray([0.2, 0.1])
    jacobian = jax.jacfwd(footstep)(velocity)
    np.testing.assert_allclose(jacobian, jax.jacrev(footstep)(velocity), atol=1e-10)
    step = 1e-6
    numeric = np.stack(
        [(footstep(velocity.at[k].add(step)) - footstep(velocity.at[k].add(-step))) / (2 * step) for k in (0, 1)], 1
    )
    np.testing.assert_allclose(jacobian, numeric, atol=1e-6)
