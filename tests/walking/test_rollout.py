"""Roll-outs: walking on MJX and on C MuJoCo, rows that fall or break alone, and gradients of whole ticks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bruce_model import load_mujoco
from iwalker_jax.control import make_controller, make_plan, velocity_footsteps
from iwalker_jax.geometry import side_of_step
from iwalker_jax.robot import load_leg_kinematics, load_robot_model
from iwalker_jax.walking.mujoco_rollout import roll_out_mujoco
from iwalker_jax.walking.rollout import Conditions, Walker, roll_out, start_walk
from iwalker_jax.walking.setup import Disturbances, sample_conditions

SAMPLES, EVERY = 150, 10  # 3 s


@pytest.fixture(scope="module")
def model():
    return load_mujoco()


@pytest.fixture(scope="module")
def walker(model):
    robot = load_robot_model(model)
    return Walker(robot, make_controller(robot), load_leg_kinematics(model))


@pytest.fixture(scope="module")
def plan():
    return make_plan(*velocity_footsteps(0.15, 0.0, 0.0, 30, 0.24, 0.1, 1), 1)


def conditions_for(walker: Walker, count: int) -> Conditions:
    """Friction 0.5 to 1, masses within 5 %, no push (a force set by a test acts within the 3 s), from home at rest."""
    calm = Disturbances(start_position=0.0, start_velocity=0.0, push_after=1.5)
    drawn = sample_conditions(walker.robot, calm, count, seed=0)
    return drawn._replace(friction=jnp.linspace(0.5, 1.0, count), mass_scale=jnp.linspace(0.95, 1.05, count))


@pytest.fixture(scope="module")
def walk(walker, plan):
    """Three robots for three seconds on MJX, one compiled program for all tests."""

    def run(conditions: Conditions):
        return roll_out(walker, conditions, plan, start_walk(walker, conditions), SAMPLES, EVERY)[1]

    return jax.jit(jax.vmap(run))


def landings(sample, plan, row: int) -> np.ndarray:
    """(k, 2) landed minus planned footsteps [m], 40 ms after each touchdown."""
    steps = np.asarray(sample.step[row])
    errors = []
    for at in np.flatnonzero(np.diff(steps) > 0) + 1:
        if at + 2 < len(steps):
            k = steps[at] - 1
            foot = side_of_step(int(plan.first_swing), k)
            errors.append(np.asarray(sample.feet[row, at + 2, foot, :2]) - np.asarray(plan.positions[k]))
    return np.asarray(errors)


def test_walks_on_mjx_with_unknown_friction_and_mass(walker, model, walk, plan):
    sample = walk(conditions_for(walker, 3))
    assert not np.any(sample.fallen)
    for row in range(3):
        errors = landings(sample, plan, row)
        assert len(errors) >= 6
        assert np.mean(np.linalg.norm(errors, axis=1)) < 0.03  # the start is the worst part of a walk
    assert np.max(sample.torques) <= 10.5 + 1e-5
    assert np.sum(sample.qp_failures) <= 5
    # Each foot carries the whole weight in turn: vertical forces sum to it on average.
    total = np.asarray(sample.forces)[:, 50:, :, 2].sum(-1).mean(1)
    weight = -float(model.opt.gravity[2]) * float(model.body_mass.sum())
    np.testing.assert_allclose(total, weight * np.linspace(0.95, 1.05, 3), rtol=0.1)


def test_a_broken_or_pushed_robot_leaves_its_neighbours_alone(walker, walk):
    clean = conditions_for(walker, 3)
    qvel = clean.qvel.at[1, 0].set(jnp.nan)
    force = clean.push_force.at[2, 0].set(200.0)  # 20 N s: 4.5 m/s of a free body of this mass
    alone, disturbed = walk(clean), walk(clean._replace(qvel=qvel, push_force=force))
    np.testing.assert_array_equal(disturbed.qpos[0], alone.qpos[0])
    assert bool(disturbed.fallen[1, -1])
    assert bool(disturbed.fallen[2, -1])
    assert np.all(np.isfinite(np.asarray(disturbed.qpos)[2]))


def test_c_mujoco_walks_alike(walker, model, walk, plan):
    conditions = conditions_for(walker, 3)
    ours = walk(conditions)
    theirs = roll_out_mujoco(walker, model, conditions, plan, 100, EVERY)
    assert not theirs.fallen.any()
    # Standing is stable, so both engines agree closely; walking amplifies rounding until feedback holds it.
    np.testing.assert_allclose(theirs.com[:, :40], np.asarray(ours.com)[:, :40], atol=1e-3)
    np.testing.assert_allclose(theirs.com[:, :100], np.asarray(ours.com)[:, :100], atol=3e-2)
