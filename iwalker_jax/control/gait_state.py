"""What the step clock remembers, needs to know and asks for, and the footsteps that are due next."""

from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.swing import TrajectoryPoint
from iwalker_jax.geometry import Side, angle_between, other_side, side_of_step


class GaitMode(IntEnum):
    """What the step clock does: stands, shifts the weight to the first stance foot, or walks."""

    STAND = 0
    SHIFT = 1
    WALK = 2


class GaitState(NamedTuple):
    """Memory of the step clock. Feet are indexed by `Side`.

    Attributes:
        mode: () int32, a `GaitMode`.
        time: () [s] in the present mode; in WALK since the last touchdown.
        phase: () 0..1 through the present swing.
        late: () [s] since the swing foot should have met the floor.
        stance: () int32, the `Side` of the stance foot (in STAND and SHIFT the one that will carry the first step).
        step: () int32, footsteps taken.
        swing: horizontal reference of the swing foot (2,), world frame.
        lift_off: (2,) height above the stance foot [m] and yaw [rad] of the swing foot when it left the floor.
        target: (3,) x, y [m] and yaw [rad] of the present footstep.
        heading: () [rad] of the torso's reference at the last touchdown.
        com_start: (2,) [m] where the COM's standing reference started from.
        home: (2, 3) x, y [m] and yaw [rad] of both feet where a robot without a plan steps on the spot: the start,
            or where it began to tip.
        offset: (2,) [m] by which the plan has been moved.
        residual: (2, 2, 2, 2) learned errors of the pendulum's pre-impact prediction: stance side; made at touchdown
            or at the freeze; sagittal or lateral; position [m] or velocity [m/s].
        stride: () [m] planned sagittal length of the present step.
        pendulum: (2, 2, 2) pendulums started at the last touchdown and at the freeze: plane, position and velocity.
    """

    mode: Int[Array, ""]
    time: Float[Array, ""]
    phase: Float[Array, ""]
    late: Float[Array, ""]
    stance: Int[Array, ""]
    step: Int[Array, ""]
    swing: TrajectoryPoint
    lift_off: Float[Array, "2"]
    target: Float[Array, "3"]
    heading: Float[Array, ""]
    com_start: Float[Array, "2"]
    home: Float[Array, "2 3"]
    offset: Float[Array, "2"]
    residual: Float[Array, "2 2 2 2"]
    stride: Float[Array, ""]
    pendulum: Float[Array, "2 2 2"]


class Posture(NamedTuple):
    """What the step clock needs to know of the robot, world frame.

    Attributes:
        com, com_velocity: (3,) [m, m/s].
        feet: (2, 3) [m] middle of each sole.
        foot_yaws: (2,) [rad].
        touching: (2,) bool, feet that press on the floor.
    """

    com: Float[Array, "3"]
    com_velocity: Float[Array, "3"]
    feet: Float[Array, "2 3"]
    foot_yaws: Float[Array, "2"]
    touching: Bool[Array, "2"]


class GaitReference(NamedTuple):
    """What the whole body shall do at this tick, world frame.

    Attributes:
        stance: (2,) 1 for feet that carry, 0 for the swing foot.
        foot: (3,) motion of the swing foot.
        foot_yaw: () motion of its yaw.
        com_acceleration: (2,) [m/s^2] horizontal.
        com_height: () [m].
        heading: () motion of the torso's yaw.
    """

    stance: Float[Array, "2"]
    foot: TrajectoryPoint
    foot_yaw: TrajectoryPoint
    com_acceleration: Float[Array, "2"]
    com_height: Float[Array, ""]
    heading: TrajectoryPoint


def foot_poses(posture: Posture) -> Float[Array, "2 3"]:
    """x, y [m] and yaw [rad] of both feet."""
    return jnp.concatenate([posture.feet[:, :2], posture.foot_yaws[:, None]], axis=1)


def mean_yaw(yaws: Float[Array, "2"]) -> Float[Array, ""]:
    """Direction [rad] midway between those of both feet."""
    return yaws[Side.RIGHT] + angle_between(yaws[Side.LEFT], yaws[Side.RIGHT]) / 2


def planned_footsteps(
    plan: FootstepPlan, state: GaitState, count: int
) -> tuple[Float[Array, "n 2"], Float[Array, " n"], Bool[Array, " n"]]:
    """The next footsteps: positions (n, 2) [m], yaws (n,) [rad] and whether each is still in the plan (n,).

    Beyond its end the plan repeats its last step of either foot; without a plan the feet keep their places.
    """
    ahead = state.step + jnp.arange(count)
    foot = side_of_step(other_side(state.stance), jnp.arange(count))
    last = plan.count - 1
    last = last - (side_of_step(plan.first_swing, last) != foot)
    row = jnp.clip(jnp.where(ahead < plan.count, ahead, last), 0, plan.yaws.shape[0] - 1)
    planned = plan.count > 0
    positions = jnp.where(planned, plan.positions[row] + state.offset, state.home[foot, :2])
    return positions, jnp.where(planned, plan.yaws[row], state.home[foot, 2]), ahead < plan.count
