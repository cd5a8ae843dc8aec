"""Varied robots: MJX and C models get the same numbers."""

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.robot.variation import vary, vary_mujoco

CHANGES = {
    "mass_scale": 1.1,
    "friction": 0.4,
    "com_shift": np.array([0.01, 0.0, -0.02]),
    "torso_mass": 0.3,
    "joint_damping": 0.05,
    "armature_scale": 1.5,
}
FIELDS = (
    "body_mass",
    "body_subtreemass",
    "body_inertia",
    "body_ipos",
    "dof_armature",
    "tendon_armature",
    "dof_damping",
    "geom_friction",
    "pair_friction",
)


def test_both_engines_get_the_same_numbers(robot64, bruce, x64):
    ours, theirs = vary(robot64, **CHANGES).model, vary_mujoco(bruce, **CHANGES)
    for name in FIELDS:
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), atol=1e-15, err_msg=name)
    np.testing.assert_allclose(theirs.body_subtreemass[1], theirs.body_mass.sum(), rtol=1e-12)


def test_nothing_changes_by_default(robot, bruce):
    before = {name: getattr(bruce, name).copy() for name in FIELDS}
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(vary(robot).model, name), getattr(robot.model, name))
        np.testing.assert_array_equal(getattr(vary_mujoco(bruce), name), before[name])
    vary_mujoco(bruce, mass_scale=2.0)
    np.testing.assert_array_equal(bruce.body_mass, before["body_mass"])


def test_traced_numbers_in_a_batch(robot):
    scales = jnp.array([0.9, 1.0, 1.1])
    masses = jax.vmap(lambda scale: vary(robot, mass_scale=scale).model.body_subtreemass[1])(scales)
    np.testing.assert_allclose(masses, scales * robot.model.body_subtreemass[1], rtol=1e-6)
