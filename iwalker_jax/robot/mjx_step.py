"""One step of the robot's physics by MJX's own `mjx.step`: what `physics.complete_step` equals, to compare with.

It repeats the kinematics that the controller has made already, solves for as many iterations as the model's options
say, and has no derivatives in reverse mode, because JAX has none of the solver's `while_loop`.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.robot.dynamics import SmoothStages
from iwalker_jax.robot.engine import mjx
from iwalker_jax.robot.model import RobotModel
from iwalker_jax.robot.physics import PhysicsInfo, PhysicsState, contact_forces, imu_readings


def complete_step_by_mjx(
    robot: RobotModel,
    state: PhysicsState,
    data: SmoothStages,
    torques: Float[Array, " nu"],
    external_force: Float[Array, "6"] | None = None,
) -> tuple[PhysicsState, PhysicsInfo]:
    """Advance by one time step; arguments and results are those of `complete_step`.

    The number of iterations is -1, because MJX does not tell it.

    Args:
        data: `smooth_stages` of the state, for the IMU's place alone.
    """
    before = mjx.make_data(robot.model, impl="jax")
    before = before.replace(
        qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.warmstart, time=state.time, ctrl=torques
    )
    if external_force is not None:
        before = before.replace(xfrc_applied=before.xfrc_applied.at[robot.base].set(external_force))
    after = mjx.step(robot.model, before)
    contact = after._impl.contact
    rows = after._impl.efc_force[contact.efc_address[:, None] + np.arange(4)]
    forces, distances = contact_forces(robot, contact, rows.ravel())
    gyro, accelerometer = imu_readings(robot, data, after.qacc)
    info = PhysicsInfo(
        after.qacc,
        forces,
        distances,
        jnp.any(forces != 0, axis=1),
        gyro,
        accelerometer,
        _residual(robot, after),
        jnp.full((), -1, jnp.int32),
    )
    return PhysicsState(after.qpos, after.qvel, after.qacc, after.time), info


def _residual(robot: RobotModel, data: mjx.Data) -> Float[Array, ""]:
    """Largest unbalanced force relative to the largest inertial or smooth force."""
    inertial = mjx.mul_m(robot.model, data, data.qacc)
    unbalanced = data.qfrc_smooth + data.qfrc_constraint - inertial
    largest = jnp.maximum(jnp.max(jnp.abs(inertial)), jnp.max(jnp.abs(data.qfrc_smooth)))
    return jnp.max(jnp.abs(unbalanced)) / largest
