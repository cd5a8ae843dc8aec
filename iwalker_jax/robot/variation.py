"""Variations of a robot: what the controller believes is one thing, what walks is another.

The same changes apply to the MJX model, with traced numbers inside `vmap`, and to a C MuJoCo model. Neither updates
the inverse inertias at rest that scale the contacts' softness (body_invweight0, dof_invweight0): both engines agree.
"""

import copy
from dataclasses import replace
from types import ModuleType
from typing import Any

import jax.numpy as jnp
import mujoco
import numpy as np

from iwalker_jax.checks import Scalar
from iwalker_jax.robot.model import RobotModel


def vary(
    robot: RobotModel,
    mass_scale: Scalar = 1.0,
    friction: Scalar | None = None,
    com_shift: Any = 0.0,
    torso_mass: Scalar = 0.0,
    joint_damping: Scalar | None = None,
    armature_scale: Scalar = 1.0,
) -> RobotModel:
    """The robot with other physics; every number may be traced.

    Args:
        mass_scale: factor of all masses and inertias.
        friction: sliding coefficient of every geom; unchanged by default.
        com_shift: (3,) displacement of the torso's COM in the base frame [m].
        torso_mass: point mass added at the torso's COM [kg].
        joint_damping: viscous damping of every joint [N m s/rad]; unchanged by default.
        armature_scale: factor of all reflected inertias.
    """
    fields = _varied(
        jnp, robot.model, robot.base, mass_scale, friction, com_shift, torso_mass, joint_damping, armature_scale
    )
    return replace(robot, model=robot.model.replace(**fields), damped=robot.damped or joint_damping is not None)


def vary_mujoco(
    model: mujoco.MjModel,
    mass_scale: float = 1.0,
    friction: float | None = None,
    com_shift: Any = 0.0,
    torso_mass: float = 0.0,
    joint_damping: float | None = None,
    armature_scale: float = 1.0,
) -> mujoco.MjModel:
    """A copy of a C MuJoCo model with other physics; see `vary`."""
    varied, base = copy.deepcopy(model), int(model.jnt_bodyid[0])
    fields = _varied(np, model, base, mass_scale, friction, com_shift, torso_mass, joint_damping, armature_scale)
    for name, value in fields.items():
        getattr(varied, name)[:] = value
    return varied


def _varied(
    xp: ModuleType,
    model: Any,
    base: int,
    mass_scale: Scalar,
    friction: Scalar | None,
    com_shift: Any,
    torso_mass: Scalar,
    joint_damping: Scalar | None,
    armature_scale: Scalar,
) -> dict[str, Any]:
    """Changed fields of an MJX (`xp` = jax.numpy) or C (`xp` = numpy) model."""
    bodies = np.arange(model.nbody)
    carried = (bodies == base) | (bodies == 0)
    joints = np.arange(model.nv) >= 6
    fields = {
        "body_mass": model.body_mass * mass_scale + (bodies == base) * torso_mass,
        "body_subtreemass": model.body_subtreemass * mass_scale + carried * torso_mass,
        "body_inertia": model.body_inertia * mass_scale,
        "body_ipos": model.body_ipos + (bodies == base)[:, None] * xp.asarray(com_shift),
        "dof_armature": model.dof_armature * armature_scale,
        "tendon_armature": model.tendon_armature * armature_scale,
    }
    if friction is not None:
        sliding = np.arange(3) == 0
        fields["geom_friction"] = xp.where(sliding, friction, model.geom_friction)
        fields["pair_friction"] = xp.where(np.arange(5) < 2, friction, model.pair_friction)
    if joint_damping is not None:
        fields["dof_damping"] = xp.where(joints, joint_damping, model.dof_damping)
    return {name: value.astype(getattr(model, name).dtype) for name, value in fields.items()}
