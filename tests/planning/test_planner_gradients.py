"""Derivatives of both networks' plans in what they see: central differences in double precision."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from iwalker_jax.perception import CameraMount, Intrinsics
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.planning.robot_state import StepGeometry, standing_state
from iwalker_jax.planning.split_module import split_module

CAMERA = Intrinsics(96, 64, 48.0, 48.0, 47.5, 31.5)


def test_path_and_footsteps_feel_depth_goal_mount_and_state(x64):
    """Oracle: central differences, forward and reverse mode; pixels without a return have no derivative."""
    config = PlannerConfig(ipath=IPathConfig(camera=CAMERA, trunk_width=4, hidden=8, equivariant=False))
    network = split_module(Planner(config, nnx.Rngs(0)))
    network = network.with_params(jax.tree.map(lambda leaf: leaf.astype(jnp.float64), network.params))
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.6, 1.6, (1, CAMERA.height, CAMERA.width))
    depth[:, :4, :6] = 0.0
    standing = standing_state(StepGeometry())
    inputs = {
        "depth": depth,
        "goal": np.array([[2.0, 0.5]]),
        "mount": np.asarray(CameraMount().as_array(), float)[None],
        "com": np.asarray(standing.com_from_stance, float)[None],
        "velocity": np.asarray(standing.com_velocity, float)[None],
    }
    inputs = jax.tree.map(jnp.asarray, inputs)

    def plan(inputs):
        planner = network.merge()
        seen = jnp.where(depth > 0, inputs["depth"], 0.0)
        path, _, fear = planner.plan_path(seen, inputs["goal"], inputs["mount"], cleaned=True)
        rows = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64)[None], standing)
        state = rows._replace(com_from_stance=inputs["com"], com_velocity=inputs["velocity"])
        return jnp.concatenate([path.ravel(), fear, planner.istepper(path, state).ravel()])

    value = jax.jit(plan)
    forward = jax.jit(lambda direction: jax.jvp(plan, (inputs,), (direction,))[1])
    cotangent = jnp.asarray(rng.normal(size=value(inputs).shape))
    reverse = jax.jit(lambda cotangent: jax.vjp(plan, inputs)[1](cotangent)[0])(cotangent)
    np.testing.assert_array_equal(np.asarray(reverse["depth"])[depth == 0], 0)
    for name in inputs:
        direction = jax.tree.map(jnp.zeros_like, inputs)
        direction[name] = jnp.asarray(rng.normal(size=inputs[name].shape))
        along = jnp.vdot(cotangent, forward(direction))
        ahead, behind = (value(jax.tree.map(lambda x, d, s=s: x + s * d, inputs, direction)) for s in (1e-7, -1e-7))
        numeric = jnp.vdot(cotangent, ahead - behind) / 2e-7
        scale = float(jnp.linalg.norm(reverse[name]))
        assert scale > 0, name
        np.testing.assert_allclose(along, numeric, atol=1e-4 * scale, err_msg=name)
        np.testing.assert_allclose(jnp.vdot(reverse[name], direction[name]), along, atol=1e-8 * scale, err_msg=name)
