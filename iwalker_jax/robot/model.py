"""Loading a robot: an MJCF model checked once, and everything index-like in it derived from names.

A robot qualifies if it has a floating base, the sites `FEET` and "imu", on both feet's bodies as many contact points (a
site and a geom of one name each), the right leg's joints, then the left's, ahead of all others, and a motor per joint.
"""

from collections.abc import Sequence
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
    FEET,
    contact_bodies,
    contact_pairs,
    contact_point_names,
    leg_joint_ids,
    limb_pattern,
    motor_limits,
    motor_moments,
    site_index,
    tendon_moments,
    touching_geoms,
)
from iwalker_jax.robot.support import check_supported


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
        leg_joints: joints, and motors, of one leg.
        contact_geoms: geoms of the contact points, the right foot's first and as many on either.
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
    leg_joints: int = field(metadata={"static": True})
    contact_geoms: tuple[int, ...] = field(metadata={"static": True})
    contact_bodies: tuple[tuple[int, int], ...] = field(metadata={"static": True})
    limbs: Limbs = field(metadata={"static": True})
    joint_names: tuple[str, ...] = field(metadata={"static": True})
    motor_names: tuple[str, ...] = field(metadata={"static": True})
    time_step: float = field(metadata={"static": True})
    damped: bool = field(metadata={"static": True})

    @property
    def leg_count(self) -> int:
        """Joints, and motors, of both legs."""
        return 2 * self.leg_joints

    @property
    def ankles_roll(self) -> bool:
        """Whether the legs have six joints, so that a sole's whole attitude can be chosen, not five."""
        return self.leg_joints == 6

    @property
    def foot_points(self) -> int:
        """Contact points of one foot."""
        return len(self.contact_geoms) // 2

    @property
    def leg_positions(self) -> slice:
        """Of the positions qpos: the legs' joints."""
        return slice(7, 7 + self.leg_count)

    @property
    def arm_positions(self) -> slice:
        """Of the positions qpos: all other joints."""
        return slice(7 + self.leg_count, None)

    @property
    def leg_velocities(self) -> slice:
        """Of the velocities qvel: the legs' joints."""
        return slice(6, 6 + self.leg_count)

    @property
    def arm_velocities(self) -> slice:
        """Of the velocities qvel: all other joints."""
        return slice(6 + self.leg_count, None)


def load_robot_model(source: mujoco.MjModel | str | PathLike) -> RobotModel:
    """Read and check a robot; load it in the precision it is to be used in.

    Args:
        source: a compiled model, the path of an MJCF file, or MJCF text.

    Raises:
        InputError: MuJoCo refuses the source, a name is missing, or the model uses what is not supported.
    """
    model = compile_model(source)
    check_supported(model)
    legs = [leg_joint_ids(model, name) for name in FEET]
    _check_legs(model, *legs)
    moments = motor_moments(model)
    _check_motors(model, moments, sum(map(len, legs)))
    foot_sites = tuple(site_index(model, name) for name in FEET)
    points = contact_point_names(model)
    contact_sites = tuple(site_index(model, name) for name in points)
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
        foot_bodies=tuple(int(model.site_bodyid[site]) for site in foot_sites),
        leg_joints=len(legs[0]),
        contact_geoms=tuple(int(model.geom(name).id) for name in points),
        contact_bodies=touching,
        limbs=limb_pattern(model, [body for body, _ in touching]),
        joint_names=tuple(_name(model, "joint", k) for k in range(1, model.njnt)),
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


def _name(model: mujoco.MjModel, kind: str, index: int) -> str:
    """Name of an object."""
    return str(getattr(model, kind)(index).name)


def _check_legs(model: mujoco.MjModel, right: Sequence[int], left: Sequence[int]) -> None:
    """Require legs of as many joints, the right one's ahead of the left one's and both ahead of all other joints."""
    if len(right) != len(left) or len(right) not in (5, 6):
        raise InputError(
            f"The legs have {len(right)} and {len(left)} joints; give both five, or six with an ankle roll."
        )
    wanted = [*right, *left]
    if wanted != list(range(1, 1 + len(wanted))):
        names = ", ".join(_name(model, "joint", joint) for joint in wanted)
        raise InputError(f"The legs' joints are not the first ones; order them {names}, then the rest.")


def _check_motors(model: mujoco.MjModel, moments: Float[np.ndarray, "nu nv"], legs: int) -> None:
    """Require one motor a joint, those of the legs' joints first, that together can give any joint torques."""
    joints = model.nv - 6
    if model.nu != joints or np.linalg.matrix_rank(moments[:, 6:]) < joints:
        raise InputError(
            f"The robot's {model.nu} motors do not drive its {joints} joints one to one; add a motor each."
        )
    if np.any(moments[:legs, 6 + legs :]) or np.any(moments[legs:, 6 : 6 + legs]):
        raise InputError(f"The first {legs} motors must drive the legs and the others the rest; reorder <actuator>.")
