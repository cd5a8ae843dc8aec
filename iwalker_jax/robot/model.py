"""Loading a robot: an MJCF model checked once, and everything index-like in it derived from names.

A robot qualifies if it has a floating base, the joints `LEG_JOINTS` on both legs ahead of all other joints, the sites
of `CONTACT_POINTS`, `FEET` and "imu", spheres or other geoms named as the contact points, and a motor per joint.
"""

from dataclasses import dataclass, field
from os import PathLike

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.robot.engine import mjx
from iwalker_jax.robot.limbs import Limbs
from iwalker_jax.robot.skeleton import Skeleton, load_skeleton
from iwalker_jax.robot.structure import (
    contact_bodies,
    contact_pairs,
    limb_pattern,
    motor_limits,
    motor_moments,
    tendon_moments,
    touching_geoms,
)
from iwalker_jax.robot.support import check_supported

LEG_JOINTS = ("hip_yaw", "hip_pitch", "hip_roll", "knee_pitch", "ankle_pitch")
"""Joints of a leg, hip first; the right leg's carry the ending _r, the left's _l."""
LEG_COUNT = 2 * len(LEG_JOINTS)
"""Joints, and motors, of both legs."""
LEG_POSITIONS = slice(7, 7 + LEG_COUNT)
"""Of the positions qpos: the legs' joints."""
ARM_POSITIONS = slice(7 + LEG_COUNT, None)
"""Of the positions qpos: all other joints."""
LEG_VELOCITIES = slice(6, 6 + LEG_COUNT)
"""Of the velocities qvel: the legs' joints."""
ARM_VELOCITIES = slice(6 + LEG_COUNT, None)
"""Of the velocities qvel: all other joints."""
CONTACT_POINTS = ("toe_r", "heel_r", "toe_l", "heel_l")
"""Sites where the feet touch the floor, and the geoms that do it."""
FEET = ("midfoot_r", "midfoot_l")
"""Sites midway between toe and heel at sole height, in the foot's axes."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RobotModel:
    """One robot; a pytree whose numbers may be traced (see `variation.vary`).

    Joints are ordered as in the velocity vector: right leg, left leg, then the others.

    Attributes:
        model: the MJX model.
        motor_moments: (nu, nv) generalised force of a unit motor torque.
        motor_limits: (nu, 2) least and largest motor torque [N m].
        tendon_moments: (nt, nv) rate of each tendon's length by velocity.
        skeleton: constants of the kinematics.
        home: (nq,) positions of the first keyframe, or the model's reference.
        base, foot_bodies: bodies.
        contact_geoms: geoms of the contact points.
        contact_bodies: of each possible contact the body that moves, and 1 if the normal points to it, else -1.
        limbs: the pattern of the mass matrix.
        joint_names, motor_names: in the model's order.
        time_step: [s] of the physics.
        damped: whether any joint has viscous damping.
    """

    model: mjx.Model
    motor_moments: Float[Array, "nu nv"]
    motor_limits: Float[Array, "nu 2"]
    tendon_moments: Float[Array, "nt nv"]
    skeleton: Skeleton
    home: Float[Array, " nq"]
    base: int = field(metadata={"static": True})
    foot_bodies: tuple[int, ...] = field(metadata={"static": True})
    contact_geoms: tuple[int, ...] = field(metadata={"static": True})
    contact_bodies: tuple[tuple[int, int], ...] = field(metadata={"static": True})
    limbs: Limbs = field(metadata={"static": True})
    joint_names: tuple[str, ...] = field(metadata={"static": True})
    motor_names: tuple[str, ...] = field(metadata={"static": True})
    time_step: float = field(metadata={"static": True})
    damped: bool = field(metadata={"static": True})


def load_robot(source: mujoco.MjModel | str | PathLike) -> RobotModel:
    """Read and check a robot; load it in the precision it is to be used in.

    Args:
        source: a compiled model, the path of an MJCF file, or MJCF text.

    Raises:
        InputError: MuJoCo refuses the source, a name is missing, or the model uses what is not supported.
    """
    model = compile_model(source)
    check_supported(model)
    joints = [_name(model, "joint", k) for k in range(1, model.njnt)]
    _check_joints(joints)
    moments = motor_moments(model)
    _check_motors(model, moments)
    foot_sites = tuple(site_index(model, name) for name in FEET)
    foot_bodies = tuple(int(model.site_bodyid[site]) for site in foot_sites)
    contact_sites = tuple(site_index(model, name) for name in CONTACT_POINTS)
    for k, name in enumerate(CONTACT_POINTS):
        if model.site_bodyid[contact_sites[k]] != foot_bodies[k // 2]:
            raise InputError(f"Sites {name!r} and {FEET[k // 2]!r} lie on different bodies; move both to the foot.")
    imu = site_index(model, "imu")
    base = int(model.jnt_bodyid[0])
    if model.site_bodyid[imu] != base:
        raise InputError("Site 'imu' is not on the floating base; move it there.")
    device_model = mjx.put_model(model, impl="jax")
    pairs = contact_pairs(model, device_model)
    touching = contact_bodies(model, pairs)
    return RobotModel(
        model=device_model,
        motor_moments=jnp.asarray(moments),
        motor_limits=jnp.asarray(motor_limits(model)),
        tendon_moments=jnp.asarray(tendon_moments(model)),
        skeleton=load_skeleton(model, (*contact_sites, *foot_sites, imu), touching_geoms(pairs)),
        home=jnp.asarray(model.key_qpos[0] if model.nkey else model.qpos0),
        base=base,
        foot_bodies=foot_bodies,
        contact_geoms=tuple(_geom_index(model, name) for name in CONTACT_POINTS),
        contact_bodies=touching,
        limbs=limb_pattern(model, [body for body, _ in touching]),
        joint_names=tuple(joints),
        motor_names=tuple(_name(model, "actuator", k) for k in range(model.nu)),
        time_step=float(model.opt.timestep),
        damped=bool(np.any(model.dof_damping > 0)),
    )


def compile_model(source: mujoco.MjModel | str | PathLike) -> mujoco.MjModel:
    """The compiled model of a source.

    Raises:
        InputError: there is no such file, or MuJoCo refuses it.
    """
    if isinstance(source, mujoco.MjModel):
        return source
    try:
        if isinstance(source, str) and source.lstrip().startswith("<"):
            return mujoco.MjModel.from_xml_string(source)
        return mujoco.MjModel.from_xml_path(str(source))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"MuJoCo cannot load the robot ({reason}); give an MJCF file, its text or a model.") from error


def site_index(model: mujoco.MjModel, name: str) -> int:
    """Index of a site.

    Raises:
        InputError: there is none of that name.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if index < 0:
        raise InputError(f"The robot has no site {name!r}; add it to the MJCF model.")
    return index


def _name(model: mujoco.MjModel, kind: str, index: int) -> str:
    """Name of an object."""
    return str(getattr(model, kind)(index).name)


def _geom_index(model: mujoco.MjModel, name: str) -> int:
    """Index of the geom of a contact point."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if index < 0:
        raise InputError(f"The robot has no geom {name!r}, which touches the floor; name the foot's contact geom so.")
    return index


def _check_joints(names: list[str]) -> None:
    """Require the legs' joints, right leg first."""
    wanted = [f"{name}_{side}" for side in "rl" for name in LEG_JOINTS]
    missing = [name for name in wanted if name not in names]
    if missing:
        raise InputError(f"The robot lacks the joints {', '.join(missing)}; name the legs' joints so.")
    if names[: len(wanted)] != wanted:
        raise InputError(
            f"The joints start {', '.join(names[: len(wanted)])}; order them {', '.join(wanted)}, then the rest."
        )


def _check_motors(model: mujoco.MjModel, moments: Float[np.ndarray, "nu nv"]) -> None:
    """Require one motor a joint, the legs' first, that together can give any joint torques."""
    joints = model.nv - 6
    if model.nu != joints or np.linalg.matrix_rank(moments[:, 6:]) < joints:
        raise InputError(
            f"The robot's {model.nu} motors do not drive its {joints} joints one to one; add a motor each."
        )
    if np.any(moments[:LEG_COUNT, ARM_VELOCITIES]) or np.any(moments[LEG_COUNT:, LEG_VELOCITIES]):
        raise InputError(
            f"The first {LEG_COUNT} motors must drive the legs and the others the rest; reorder <actuator>."
        )
