"""The posture and velocity that put COM and feet where they are wanted, under an upright torso: inverse kinematics.

Base position and legs of five joints are 13 unknowns; the COM, both feet's places, pitch and yaw are 13 equations. Legs
of six joints add two unknowns, and the feet's roll two equations. Newton's steps find the posture; its derivatives come
from one more step whose matrix is held, which is the implicit function theorem. The same matrix gives the velocities.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.robot.model import RobotModel
from iwalker_jax.robot.rigid_body import RigidBodyTerms, rigid_body_terms

_ITERATIONS = 8
_LONGEST = 0.3  # m or rad; a longer Newton step is shortened to this
_TOLERANCE = 1e-4  # m or rad


class Placement(NamedTuple):
    """A state of the robot.

    Attributes:
        qpos: (nq,); qvel: (nv,).
        converged: () whether it is as wanted; if not, it is the home posture at rest, without derivatives.
    """

    qpos: Float[Array, " nq"]
    qvel: Float[Array, " nv"]
    converged: Bool[Array, ""]


def place_robot(
    robot: RobotModel,
    com: Float[Array, "3"],
    com_velocity: Float[Array, "3"],
    feet: Float[Array, "2 3"],
    feet_velocities: Float[Array, "2 3"],
) -> Placement:
    """State with the torso upright and facing along x, the feet flat and pointing along x, and the arms at home.

    Args:
        com: [m]; com_velocity: [m/s]; world frame.
        feet: (2, 3) [m] middles of the right and the left foot; feet_velocities: (2, 3) [m/s].
    """
    home, rest = robot.home.astype(com.dtype), jnp.zeros(robot.model.nv, com.dtype)
    wanted = jax.lax.stop_gradient((com, feet))
    chosen = np.r_[0:3, robot.leg_positions].astype(np.int32)

    def improve(_: Array, guess: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        qpos, rows, missing = guess
        step = jnp.linalg.solve(rows, missing)
        step = step * jnp.minimum(1.0, _LONGEST / jnp.maximum(jnp.max(jnp.abs(step)), 1e-9))
        qpos = qpos.at[chosen].add(step)
        return qpos, *_equations(robot, rigid_body_terms(robot, qpos, rest), *wanted)

    eye, nothing = jnp.eye(chosen.size, dtype=com.dtype), jnp.zeros(chosen.size, com.dtype)
    start = home.at[:2].set(wanted[0][:2])
    found, rows, missing = jax.lax.fori_loop(0, _ITERATIONS + 1, improve, (start, eye, nothing))
    low, high = robot.model.jnt_range[1 : 1 + robot.leg_count].astype(com.dtype).T
    legs = found[robot.leg_positions]
    # Comparisons with NaN are false.
    converged = (jnp.max(jnp.abs(missing)) < _TOLERANCE) & jnp.all((legs > low) & (legs < high))

    # One more step, whose matrix and start are constants: its value is nearly zero, its derivative exact.
    level = jnp.zeros(chosen.size - 9, com.dtype)
    targets = jnp.concatenate([com, feet.reshape(-1), level])
    missing = jax.lax.stop_gradient(missing) + targets - jax.lax.stop_gradient(targets)
    step = jnp.linalg.solve(jnp.where(converged, rows, eye), jnp.where(converged, missing, 0.0))
    qpos = jnp.where(converged, found, home).at[chosen].add(step)
    rows, _ = _equations(robot, rigid_body_terms(robot, qpos, rest), com, feet)
    moving = jnp.concatenate([com_velocity, feet_velocities.reshape(-1), level])
    qvel = rest.at[_velocities(robot)].set(jnp.linalg.solve(rows, jnp.where(converged, moving, 0.0)))
    return Placement(qpos, qvel, converged)


def _velocities(robot: RobotModel) -> Int[np.ndarray, " n"]:
    """Of the velocities qvel: the unknowns'."""
    return np.r_[0:3, robot.leg_velocities].astype(np.int32)


def _equations(
    robot: RobotModel, terms: RigidBodyTerms, com: Float[Array, "3"], feet: Float[Array, "2 3"]
) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    """Jacobian of COM, feet, and the feet's attitudes in the unknowns, and what each is away from its place."""
    forward = terms.foot_rotations[:, :, 0]
    level = jnp.sqrt(forward[:, 0] ** 2 + forward[:, 1] ** 2 + 1e-12)
    lateral = jnp.stack([-forward[:, 1], forward[:, 0], jnp.zeros_like(level)], axis=1) / level[:, None]
    turns = terms.foot_jacobians[:, 3:]
    pitch = jnp.einsum("fi,fij->fj", lateral, turns)
    rows = [terms.com_jacobian, terms.foot_jacobians[:, :3].reshape(6, -1), pitch, turns[:, 2]]
    missing = [
        com - terms.com,
        (feet - terms.foot_positions).reshape(-1),
        forward[:, 2],
        -jnp.arctan2(forward[:, 1], forward[:, 0]),
    ]
    if robot.ankles_roll:
        rows.append(jnp.einsum("fi,fij->fj", forward, turns))
        missing.append(-terms.foot_rotations[:, 2, 1])
    return jnp.concatenate(rows)[:, _velocities(robot)], jnp.concatenate(missing)
