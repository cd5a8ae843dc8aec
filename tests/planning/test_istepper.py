"""iStepper and planner: really uses the robot state, and is exactly mirror-equivariant."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from iwalker_jax.optimization import HlipParameters
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.planner import PATH_POINTS, Planner, PlannerConfig, waypoints_to_path
from iwalker_jax.planning.robot_state import RobotState, StepGeometry, sample_robot_state
from iwalker_jax.planning.split_module import split_module

GEOMETRY = StepGeometry()


def _paths(count: int) -> jax.Array:
    waypoints = jnp.cumsum(0.4 * jax.random.normal(jax.random.key(0), (count, 5, 2)) + jnp.asarray([0.6, 0.0]), axis=1)
    return waypoints_to_path(waypoints)


def _states(count: int) -> RobotState:
    keys = jax.random.split(jax.random.key(1), count)
    return jax.vmap(lambda key: sample_robot_state(key, GEOMETRY, HlipParameters()))(keys)


def test_mirrored_world_gives_mirrored_footsteps():
    stepper = IStepper(IStepperConfig(), GEOMETRY, nnx.Rngs(0))
    flip = jnp.asarray([1.0, -1.0])
    paths, states = _paths(8), _states(8)
    np.testing.assert_allclose(stepper(paths * flip, states.mirrored()), stepper(paths, states) * flip, atol=1e-5)


def test_every_part_of_the_robot_state_matters():
    stepper = IStepper(IStepperConfig(), GEOMETRY, nnx.Rngs(0))
    paths, states = _paths(2), _states(2)
    before = stepper(paths, states)
    changes = {
        "com_from_stance": states.com_from_stance + 0.05,
        "com_velocity": states.com_velocity + 0.2,
        "stance_sign": -states.stance_sign,
        "time_in_step": states.time_in_step + 0.05,
    }
    for name, value in changes.items():
        after = stepper(paths, states._replace(**{name: value}))
        assert float(jnp.max(jnp.abs(after - before))) > 1e-4, name


def test_corrections_are_bounded():
    stepper = IStepper(IStepperConfig(correction=0.05), GEOMETRY, nnx.Rngs(2))
    straight = jnp.stack([jnp.linspace(0, 4, PATH_POINTS), jnp.zeros(PATH_POINTS)], axis=1)[None]
    state = jax.tree.map(lambda x: x[:1], _states(1))
    assert float(jnp.max(jnp.abs(stepper(straight, state)[0, :, 1]))) <= GEOMETRY.width / 2 + 0.05 + 1e-6


def test_planner_is_one_jittable_function_from_depth_to_footsteps():
    planner = Planner(PlannerConfig(), nnx.Rngs(0))
    plan = jax.jit(lambda network, *inputs: network.merge()(*inputs))(
        split_module(planner), jnp.full((2, 90, 160), 3.0), jnp.asarray([[2.0, 0.0], [1.0, 1.0]]), _states(2)
    )
    assert plan.path.shape == (2, PATH_POINTS, 2)
    assert plan.footsteps.shape == (2, GEOMETRY.count, 2)
    np.testing.assert_allclose(plan.path[:, 0], 0.0, atol=1e-7)
    np.testing.assert_allclose(plan.path[:, -1], plan.waypoints[:, -1], atol=1e-5)
