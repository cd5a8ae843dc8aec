"""The posture and velocity that put COM and feet where they are wanted, under an upright torso: inverse kinematics.

Base position and leg joints are 13 unknowns; the COM, both feet's places, pitch and yaw are 13 equations. Newton's
steps find the posture; its derivatives come from one more step whose matrix is held, which is the implicit function
theorem. The same matrix gives the velocities.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.robot.model import LEG_COUNT, LEG_POSITIONS, LEG_VELOCITIES, RobotModel
from iwalker_jax.robot.rigid_body import RigidBodyTerms, rigid_body_terms

_ITERATIONS = 8
_LONGEST = 0.3  # m or rad; a longer Newton step is shortened to this
_TOLERANCE = 1e-4  # m or rad
_VELOCITIES = np.r_[0:3, LEG_VELOCITIES].astype(np.int32)
_POSITIONS = np.r_[0:3, LEG_POSITIONS].astype(np.int32)


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

    def improve(_: Array, guess: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        qpos, rows, missing = guess
        step = jnp.linalg.solve(rows, missing)
        step = step * jnp.minimum(1.0, _LONGEST / jnp.maximum(jnp.max(jnp.abs(step)), 1e-9))
        qpos = qpos.at[_POSITIONS].add(step)
        return qpos, *_equations(rigid_body_terms(robot, qpos, rest), *wanted)

    eye, nothing = jnp.eye(_POSITIONS.size, dtype=com.dtype), jnp.zeros(_POSITIONS.size, com.dtype)
    start = home.at[:2].set(wanted[0][:2])
    found, rows, missing = jax.lax.fori_loop(0, _ITERATIONS + 1, improve, (start, eye, nothing))
    low, high = robot.model.jnt_range[1 : 1 + LEG_COUNT].astype(com.dtype).T
    legs = found[LEG_POSITIONS]
    # Comparisons with NaN are false.
    converged = (jnp.max(jnp.abs(missing)) < _TOLERANCE) & jnp.all((legs > low) & (legs < high))

    # One more step, whose matrix and start are constants: its value is nearly zero, its derivative exact.
    targets = jnp.concatenate([com, feet.reshape(-1), jnp.zeros(4, com.dtype)])
    missing = jax.lax.stop_gradient(missing) + targets - jax.lax.stop_gradient(targets)
    step = jnp.linalg.solve(jnp.where(converged, rows, eye), jnp.where(converged, missing, 0.0))
    qpos = jnp.where(converged, found, home).at[_POSITIONS].add(step)
    rows, _ = _equations(rigid_body_terms(robot, qpos, rest), com, feet)
    moving = jnp.concatenate([com_velocity, feet_velocities.reshape(-1), jnp.zeros(4, com.dtype)])
    qvel = rest.at[_VELOCITIES].set(jnp.linalg.solve(rows, jnp.where(converged, moving, 0.0)))
    return Placement(qpos, qvel, converged)


def _equations(
    terms: RigidBodyTerms, com: Float[Array, "3"], feet: Float[Array, "2 3"]
) -> tuple[Float[Array, "13 13"], Float[Array, "13"]]:
    """Jacobian of COM, feet, and the feet's pitch and yaw in the unknowns, and what each is away from its place."""
    forward = terms.foot_rotations[:, :, 0]
    level = jnp.sqrt(forward[:, 0] ** 2 + forward[:, 1] ** 2 + 1e-12)
    lateral = jnp.stack([-forward[:, 1], forward[:, 0], jnp.zeros_like(level)], axis=1) / level[:, None]
    turns = terms.foot_jacobians[:, 3:]
    pitch = jnp.einsum("fi,fij->fj", lateral, turns)
    rows = jnp.concatenate([terms.com_jacobian, terms.foot_jacobians[:, :3].reshape(6, -1), pitch, turns[:, 2]])
    missing = jnp.concatenate(
        [
            com - terms.com,
            (feet - terms.foot_positions).reshape(-1),
            forward[:, 2],
            -jnp.arctan2(forward[:, 1], forward[:, 0]),
        ]
    )
    return rows[:, _VELOCITIES], missing
