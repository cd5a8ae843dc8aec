"""Ticks of a walk whose physics are MJX's own `mjx.step`: those of our step, controller, push and all."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.walking.commands import Motion, make_walk
from iwalker_jax.walking.rollout import roll_out, start_walk
from iwalker_jax.walking.setup import Disturbances, default_walker, sample_conditions

TICKS = 30


def test_ticks_of_a_walk_are_those_of_our_step():
    """Oracle: `mjx.step`; a robot of changed mass and friction that is pushed, from a start in motion."""
    walker, model = default_walker()
    plan = make_walk(Motion("in_place", seconds=1.0), model, walker.controller.gait).plan
    drawn = sample_conditions(walker.robot, Disturbances(start_velocity=0.1, push_impulse=2.0), 1, seed=3)
    conditions = jax.tree.map(lambda leaf: leaf[0], drawn)._replace(push_start=jnp.asarray(0.02))
    state, ends = jax.jit(start_walk)(walker, conditions), []
    for physics in ("own", "mjx.step"):
        program = jax.jit(roll_out, static_argnums=(4, 5))
        ends.append(program(dataclasses.replace(walker, physics=physics), conditions, plan, state, TICKS, 1))
    (own, record), (theirs, other) = ends
    assert np.asarray(record.forces)[:, :, 2].sum(axis=-1).min() > 0  # on the floor throughout
    assert np.abs(own.physics.qvel[0] - state.physics.qvel[0]) > 0.05  # the push was felt
    np.testing.assert_allclose(theirs.physics.qpos, own.physics.qpos, atol=1e-4)
    np.testing.assert_allclose(theirs.physics.qvel, own.physics.qvel, atol=1e-2)
    np.testing.assert_allclose(other.com, record.com, atol=1e-5)
    np.testing.assert_allclose(theirs.physics.time, own.physics.time, rtol=1e-6)
