"""Where the feet are, seen from the base: leg kinematics from joint positions and velocities alone.

Product of exponentials: with every joint at its reference angle, joint k has axis a_k and anchor o_k in the base
frame and a foot point lies at x; then x <- o_k + Rot(a_k, q_k) (x - o_k) from the foot's joint up to the hip's.
The constants are read once, by name; MuJoCo is not needed afterwards.
"""

from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.errors import InputError
from iwalker_jax.robot.structure import FEET, leg_joint_ids, site_index

FootPoint = Literal["midfoot", "toe", "heel"]
"""A point of the sole: midway between the toe and heel contacts, or one of them."""

_POINTS: tuple[FootPoint, ...] = ("midfoot", "toe", "heel")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LegKinematics:
    """Constants of both legs (right, left) in the base frame, with all joints at their reference angles.

    Attributes:
        axes: (2, joints, 3) unit axes, hip first.
        anchors: (2, joints, 3) [m] a point on each axis.
        references: (2, joints) [rad] joint positions of that pose.
        points: (2, 3, 3) [m] midfoot, toe and heel of each foot.
        starts: place of each leg's first joint among all joint positions, qpos[7:] (static).
    """

    axes: Float[Array | np.ndarray, "2 joints 3"]
    anchors: Float[Array | np.ndarray, "2 joints 3"]
    references: Float[Array | np.ndarray, "2 joints"]
    points: Float[Array | np.ndarray, "2 3 3"]
    starts: tuple[int, ...] = field(metadata={"static": True})


class FootMotion(NamedTuple):
    """Motion of one point of each foot (right, left) relative to the base, in base axes.

    Attributes:
        position: (2, 3) [m] from the base origin.
        velocity: (2, 3) [m/s] its rate of change as seen from the base.
    """

    position: Float[Array, "2 3"]
    velocity: Float[Array, "2 3"]


def load_leg_kinematics(model: mujoco.MjModel) -> LegKinematics:
    """Read both legs from a model with a floating base and the sites midfoot, toe and heel, each with _r and _l.

    Raises:
        InputError: if a site is missing, a leg has other joints than hinges in a row, or the legs differ in length.
    """
    data = mujoco.MjData(model)
    if model.njnt == 0 or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
        raise InputError("The model's first joint is not a free joint; give a robot with a floating base.")
    data.qpos[:] = model.qpos0
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    chains = [leg_joint_ids(model, name) for name in FEET]
    if len(chains[0]) != len(chains[1]):
        raise InputError(f"The legs have {len(chains[0])} and {len(chains[1])} joints; both need as many.")
    addresses = model.jnt_qposadr
    sites = [[site_index(model, f"{point}_{side}") for point in _POINTS] for side in "rl"]
    return LegKinematics(
        axes=data.xaxis[chains].copy(),
        anchors=data.xanchor[chains].copy(),
        references=model.qpos0[addresses[chains]].copy(),
        points=data.site_xpos[sites].copy(),
        starts=tuple(int(addresses[chain[0]]) - 7 for chain in chains),
    )


def foot_motion(
    legs: LegKinematics,
    joint_positions: Float[Array, " joints"],
    joint_velocities: Float[Array, " joints"],
    point: FootPoint = "midfoot",
) -> FootMotion:
    """Position and velocity of a point of both feet in the base frame; derivatives of any order are finite.

    Args:
        joint_positions: (joints,) [rad] all joints, qpos[7:].
        joint_velocities: (joints,) [rad/s] all joints, qvel[6:].
    """
    dtype = joint_positions.dtype
    angles = _per_leg(legs, joint_positions) - jnp.asarray(legs.references, dtype)
    rates = _per_leg(legs, joint_velocities)
    position = jnp.asarray(legs.points, dtype)[:, _POINTS.index(point)]
    velocity = jnp.zeros_like(position)
    for axis, anchor, angle, rate in _from_the_foot(legs, angles, rates):
        arm = _rotate(axis, angle, position - anchor)
        position = anchor + arm
        velocity = _rotate(axis, angle, velocity) + rate[:, None] * jnp.cross(axis, arm)
    return FootMotion(position, velocity)


def foot_jacobian(
    legs: LegKinematics, joint_positions: Float[Array, " joints"], point: FootPoint = "midfoot"
) -> Float[Array, "2 3 leg_joints"]:
    """Derivative of each foot point's position in the base frame by its own leg's joints [m/rad], hip first."""
    dtype = joint_positions.dtype
    angles = _per_leg(legs, joint_positions) - jnp.asarray(legs.references, dtype)
    position = jnp.asarray(legs.points, dtype)[:, _POINTS.index(point)]
    columns: list[Array] = []
    for axis, anchor, angle, _ in _from_the_foot(legs, angles, angles):
        arm = _rotate(axis, angle, position - anchor)
        position = anchor + arm
        columns = [jnp.cross(axis, arm)] + [_rotate(axis, angle, column) for column in columns]
    return jnp.stack(columns, axis=-1)


def _from_the_foot(
    legs: LegKinematics, angles: Float[Array, "2 joints"], rates: Float[Array, "2 joints"]
) -> list[tuple[Array, Array, Array, Array]]:
    """(axis, anchor, angle, rate) of both legs' joints, the foot's first."""
    axes, anchors = jnp.asarray(legs.axes, angles.dtype), jnp.asarray(legs.anchors, angles.dtype)
    return [(axes[:, k], anchors[:, k], angles[:, k], rates[:, k]) for k in reversed(range(angles.shape[1]))]


def _rotate(axis: Float[Array, "2 3"], angle: Float[Array, "2"], vector: Float[Array, "2 3"]) -> Float[Array, "2 3"]:
    """Rodrigues' formula for unit axes."""
    sine, versine = jnp.sin(angle)[:, None], (1 - jnp.cos(angle))[:, None]
    across = jnp.cross(axis, vector)
    return vector + sine * across + versine * jnp.cross(axis, across)


def _per_leg(legs: LegKinematics, joints: Float[Array, " joints"]) -> Float[Array, "2 leg_joints"]:
    """The legs' entries of an array over all joints."""
    count = legs.axes.shape[1]
    return jnp.stack([joints[start : start + count] for start in legs.starts])
