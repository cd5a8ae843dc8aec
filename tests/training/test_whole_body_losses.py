"""Whole-body losses of footsteps: derivatives against finite differences, instants against a steady walk's."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.geometry import Side
from iwalker_jax.optimization import HlipParameters
from iwalker_jax.planning.robot_state import RobotState
from iwalker_jax.training.losses import LossWeights
from iwalker_jax.training.train_step import initial_state, make_optimiser, make_train_step
from iwalker_jax.training.whole_body_losses import load_controlled_robot, swing_instants, whole_body_losses
from tests.gradients import assert_gradients_agree

SPEED, WIDTH, TIME = 0.3, 0.10, 0.24


def walking_state() -> RobotState:
    """Just after touchdown on the left foot, on the orbit of a walk at `SPEED`."""
    rate = HlipParameters().rate
    half, angle = SPEED * TIME / 2, rate * TIME / 2
    position = jnp.asarray([-half, -WIDTH / 2])
    velocity = jnp.stack([half * rate / jnp.tanh(angle), WIDTH / 2 * rate * jnp.tanh(angle)])
    return RobotState(position, velocity, jnp.ones(()), jnp.zeros(()))


def footsteps_of(state: RobotState) -> jax.Array:
    ahead = SPEED * TIME * (jnp.arange(6) + 1.0)
    return jnp.stack([ahead, -WIDTH * (jnp.arange(6) % 2 == 0)], axis=1) - state.com_from_stance


@pytest.fixture(scope="module")
def terms():
    """Terms (4,) of moved first footsteps and COM, compiled once, in double precision."""
    with jax.enable_x64(True):
        controlled = load_controlled_robot()

    @jax.jit
    def terms(move: jax.Array, com: jax.Array) -> jax.Array:
        state = walking_state()
        footsteps = footsteps_of(state).at[:2].add(move)
        state = state._replace(com_from_stance=state.com_from_stance + com)
        return jnp.stack(whole_body_losses(controlled, footsteps, state, WIDTH))

    return terms


@pytest.mark.parametrize("move", [[[0.01, 0.005], [0.02, -0.01]], [[0.05, -0.02], [0.0, 0.01]]])
def test_derivatives_reach_the_footsteps_through_the_qp(terms, move, x64):
    move, com = jnp.asarray(move), jnp.zeros(2)
    values = terms(move, com)
    assert values[3] == 1 and np.all(np.asarray(values[:3]) > 0)
    assert_gradients_agree(terms, move, com, tolerance=1e-4)


def test_footsteps_out_of_reach_cost_more_until_they_count_for_nothing(terms, x64):
    near, far, absurd = (np.asarray(terms(jnp.asarray([[x, 0.0], [x, 0.0]]), jnp.zeros(2))) for x in (0, 0.1, 0.6))
    assert np.all(far[1:3] > near[1:3]) and near[3] == 1
    assert absurd[3] < 1 and np.all(np.isfinite(absurd))
    _, pull_back = jax.vjp(terms, jnp.full((2, 2), 0.6), jnp.zeros(2))
    assert all(np.all(np.isfinite(slope)) for slope in pull_back(jnp.ones(4)))


def test_a_steady_walk_repeats_itself_mirrored(x64):
    """Both steps of an orbit are one step and its mirror image, and each swing begins where the foot last stood."""
    state = walking_state()
    instants = swing_instants(load_controlled_robot(), footsteps_of(state), state, WIDTH)
    first, second = (jax.tree.map(lambda part, k=k: np.asarray(part)[k : k + 2], instants) for k in (0, 2))
    assert (first.stance == Side.LEFT).all() and (second.stance == Side.RIGHT).all()
    stride = SPEED * TIME
    np.testing.assert_allclose(first.lift_off, [[-stride, -WIDTH]] * 2, atol=1e-12)
    np.testing.assert_allclose(first.footstep, [[stride, -WIDTH]] * 2, atol=1e-12)
    for name in ("com", "com_velocity", "lift_off", "footstep"):
        np.testing.assert_allclose(getattr(second, name), getattr(first, name) * [1, -1], atol=1e-12)


def test_training_reports_the_terms_only_where_they_weigh(small_config, small_data):
    weights = LossWeights(torque_margin=10.0, shortfall=3.0, placement=5.0)
    optimiser = make_optimiser(small_config, 4)
    losses = {}
    for name, config in (("with", dataclasses.replace(small_config, weights=weights)), ("without", small_config)):
        step = make_train_step(config, optimiser)
        _, report = step(initial_state(config, optimiser), small_data, jnp.arange(4))
        assert bool(report.finite)
        losses[name] = report.losses
    assert {"torque_margin", "shortfall", "placement", "solved"} == set(losses["with"]) - set(losses["without"])
    assert 0.5 < float(losses["with"]["solved"]) <= 1
