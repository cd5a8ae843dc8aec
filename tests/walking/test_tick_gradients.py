"""Derivatives of a whole tick, footsteps and state to torques and through contact, against central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from bruce_model import load_mujoco
from iwalker_jax.control import make_controller, make_plan, velocity_footsteps
from iwalker_jax.optimization import QpSettings
from iwalker_jax.robot import load_leg_kinematics, load_robot_model
from iwalker_jax.walking.rollout import Walker, start_walk, walk_tick
from iwalker_jax.walking.setup import Disturbances, sample_conditions

INTO_THE_WALK = 700  # ticks: 1.4 s, in the middle of the second step


@pytest.fixture(scope="module")
def walking():
    """Walker, conditions, plan and state of a robot in mid-step, in double precision."""
    with jax.enable_x64(True):
        model = load_mujoco()
        robot = load_robot_model(model)
        walker = Walker(robot, make_controller(robot, solver=QpSettings()), load_leg_kinematics(model))
        calm = Disturbances(start_position=0.0, start_velocity=0.0)
        conditions = jax.tree.map(lambda leaf: leaf[0], sample_conditions(robot, calm, 1, seed=0))
        plan = make_plan(*velocity_footsteps(0.15, 0.0, 0.0, 20, 0.24, 0.1, 1), 1)
        conditions, plan = jax.tree.map(
            lambda leaf: leaf.astype(jnp.float64) if leaf.dtype == jnp.float32 else leaf, (conditions, plan)
        )

        @jax.jit
        def walk(walker, conditions, plan):
            start = start_walk(walker, conditions)
            return jax.lax.fori_loop(
                0, INTO_THE_WALK, lambda _, state: walk_tick(walker, conditions, plan, state)[0], start
            )

        return walker, conditions, plan, walk(walker, conditions, plan)


def test_torques_and_motion_feel_footsteps_and_state_and_the_clock_nothing(walking, x64):
    """Oracle: central differences, forward and reverse mode; the step clock moves on whatever the robot does."""
    walker, conditions, plan, state = walking

    def tick(changes):
        physics = state.physics._replace(
            qvel=state.physics.qvel + changes["velocity"], qpos=state.physics.qpos.at[7:].add(changes["joints"])
        )
        moved = plan._replace(positions=plan.positions + changes["footsteps"])
        after, sample = walk_tick(walker, conditions, moved, state._replace(physics=physics))
        gait = after.memory.controller.gait
        clock = jnp.stack([gait.time, gait.phase, gait.late])
        return {"torques": sample.torques, "qvel": after.physics.qvel, "touches": sample.forces, "clock": clock}

    changes = {"footsteps": jnp.zeros(plan.positions.shape), "joints": jnp.zeros(16), "velocity": jnp.zeros(22)}
    value = jax.jit(tick)
    forward = jax.jit(lambda direction: jax.jvp(tick, (changes,), (direction,))[1])
    reverse = jax.jit(lambda cotangent: jax.vjp(tick, changes)[1](cotangent)[0])
    found = value(changes)
    assert jnp.any(found["touches"] > 1.0) and jnp.all(found["torques"] > 0)
    rng = np.random.default_rng(0)
    for name in changes:
        direction = jax.tree.map(jnp.zeros_like, changes)
        direction[name] = jnp.asarray(rng.normal(size=direction[name].shape))
        along = forward(direction)
        ahead, behind = (value(jax.tree.map(lambda d, s=s: s * d, direction)) for s in (1e-7, -1e-7))
        for part in ("torques", "qvel", "touches"):
            numeric = (ahead[part] - behind[part]) / 2e-7
            scale = float(jnp.abs(numeric).max())
            assert scale > 0
            np.testing.assert_allclose(along[part], numeric, atol=1e-4 * scale, err_msg=f"{part} by {name}")
            cotangent = jax.tree.map(jnp.zeros_like, found)
            cotangent[part] = jnp.asarray(rng.normal(size=numeric.shape))
            back = jnp.vdot(reverse(cotangent)[name], direction[name])
            np.testing.assert_allclose(back, jnp.vdot(cotangent[part], along[part]), rtol=1e-8, atol=1e-10 * scale)
        np.testing.assert_array_equal(along["clock"], 0)
        np.testing.assert_array_equal(ahead["clock"], found["clock"])
    cotangent = jax.tree.map(jnp.zeros_like, found) | {"clock": jnp.ones(3)}
    np.testing.assert_array_equal(ravel_pytree(reverse(cotangent))[0], 0)
