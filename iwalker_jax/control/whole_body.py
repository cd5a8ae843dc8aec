"""The whole-body quadratic program: leg accelerations and contact forces in, joint torques out.

The base's acceleration follows from the six unactuated rows of the equations of motion and the arms' is prescribed, so
the unknowns are x = [leg accelerations, contact forces] alone; torques are linear in x. Contacts in the air have their
Jacobian masked and their bounds lifted, so shapes never change. Eq. 16 of the iWalker paper.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.constants import GRAVITY
from iwalker_jax.control.parameters import WholeBodyParameters
from iwalker_jax.control.tasks import WholeBodyTask
from iwalker_jax.optimization import QuadraticProgram
from iwalker_jax.robot import RigidBodyTerms

FRICTION_ROWS = 5
"""Of a contact point: four sides of the pyramid and the vertical force."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Actuation:
    """How the robot's joints are driven.

    Attributes:
        motors_from_torques: (nu, nu) motor torques of joint torques, legs first as in the velocity vector.
        limits: (nu,) largest motor torques [N m].
        arm_pose: (na,) posture of the arms' joints [rad].
    """

    motors_from_torques: Float[Array, "nu nu"]
    limits: Float[Array, " nu"]
    arm_pose: Float[Array, " na"]

    @property
    def leg_count(self) -> int:
        """Joints, and motors, of both legs."""
        return self.limits.shape[0] - self.arm_pose.shape[0]


class Dynamics(NamedTuple):
    """Accelerations and torques as affine functions of the unknowns x = [leg accelerations, forces].

    Attributes:
        acceleration: (nv, n) and acceleration_offset: (nv,): qdd.
        torque: (nu, n) and torque_offset: (nu,): joint torques [N m].
    """

    acceleration: Float[Array, "nv n"]
    acceleration_offset: Float[Array, " nv"]
    torque: Float[Array, "nu n"]
    torque_offset: Float[Array, " nu"]


def reduced_dynamics(
    terms: RigidBodyTerms, carrying: Float[Array, " c"], arm_acceleration: Float[Array, " na"]
) -> Dynamics:
    """Eliminate base accelerations and torques from M qdd + h = S tau + J'F.

    Args:
        terms: rigid-body quantities; velocities are ordered base (6), legs, arms.
        carrying: (c,) 1 for contact points that carry, else 0.
        arm_acceleration: [rad/s^2] prescribed.
    """
    mass, bias = terms.mass_matrix, terms.bias
    size, arms = mass.shape[0], arm_acceleration.shape[0]
    legs = size - 6 - arms
    contacts = carrying.shape[0]
    push = (terms.contact_jacobians * carrying[:, None, None]).reshape(3 * contacts, size).T
    # Base rows: M_bb a_b = J_b' F - M_bl a_l - M_ba a_a - h_b.
    right = jnp.concatenate(
        [
            -mass[:6, 6 : 6 + legs],
            push[:6],
            (-bias[:6] - mass[:6, 6 + legs :] @ arm_acceleration)[:, None],
        ],
        axis=1,
    )
    base = _solve_positive(mass[:6, :6], right)
    unknowns = legs + 3 * contacts
    legs_part = jnp.eye(legs, unknowns, dtype=mass.dtype)
    acceleration = jnp.concatenate([base[:, :-1], legs_part, jnp.zeros((arms, unknowns), mass.dtype)])
    offset = jnp.concatenate([base[:, -1], jnp.zeros(legs, mass.dtype), arm_acceleration])
    torque = mass[6:] @ acceleration
    torque = torque.at[:, legs:].add(-push[6:])
    return Dynamics(acceleration, offset, torque, mass[6:] @ offset + bias[6:])


def _solve_positive(matrix: Float[Array, "6 6"], right: Float[Array, "6 k"]) -> Float[Array, "6 k"]:
    """Solve by Gauss-Jordan elimination without pivots, unrolled: quicker than LAPACK at this size in a batch."""
    work = jnp.concatenate([matrix, right], axis=1)
    for k in range(6):
        row = work[k] / work[k, k]
        column = work[:, k].at[k].set(0.0)
        work = (work - column[:, None] * row[None]).at[k].set(row)
    return work[:, 6:]


def whole_body_program(
    parameters: WholeBodyParameters,
    actuation: Actuation,
    dynamics: Dynamics,
    tasks: WholeBodyTask,
    carrying: Float[Array, " c"],
    mass: Float[Array, ""],
) -> QuadraticProgram:
    """Weighted least squares of the tasks under friction pyramids, unilateral contact and motor limits."""
    dtype = tasks.rows.dtype
    contacts = carrying.shape[0]
    unknowns = dynamics.acceleration.shape[1]
    legs = unknowns - 3 * contacts
    rows = tasks.rows @ dynamics.acceleration
    missing = tasks.target - tasks.rows @ dynamics.acceleration_offset
    weighted = rows * tasks.weight[:, None]
    regular = jnp.concatenate(
        [
            jnp.full(legs, parameters.regularise_acceleration, dtype),
            jnp.full(3 * contacts, parameters.regularise_force, dtype),
        ]
    )
    # An even share of the weight is the forces' rest: pulled to zero they would sag, and shift the COM.
    share = carrying * mass * GRAVITY / jnp.maximum(jnp.sum(carrying), 1.0)
    rest = jnp.concatenate([jnp.zeros(legs, dtype), (share[:, None] * jnp.asarray([0, 0, 1], dtype)).reshape(-1)])
    hessian = weighted.T @ rows + jnp.diag(regular)
    linear = -(weighted.T @ missing) - regular * rest

    pyramid = jnp.asarray([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1], [0, 0, 1]], dtype)
    pyramid = pyramid * jnp.asarray([1, 1, parameters.friction], dtype)
    pyramid = pyramid.at[4, 2].set(1.0)
    friction = jnp.kron(jnp.eye(contacts, dtype=dtype), pyramid)
    friction = jnp.concatenate([jnp.zeros((FRICTION_ROWS * contacts, legs), dtype), friction], axis=1)
    # A swing contact's forces move nothing and rest at zero: without bounds they are zero, and cost no pivots.
    low = jnp.asarray([0, 0, 0, 0, parameters.least_force], dtype)
    high = jnp.asarray([jnp.inf, jnp.inf, jnp.inf, jnp.inf, parameters.largest_force], dtype)
    low = jnp.where(carrying[:, None] > 0, low, -jnp.inf).reshape(-1)
    high = jnp.where(carrying[:, None] > 0, high, jnp.inf).reshape(-1)

    to_motors = actuation.motors_from_torques[:legs, :legs]
    motors = to_motors @ dynamics.torque[:legs]
    offset = to_motors @ dynamics.torque_offset[:legs]
    limit = actuation.limits[:legs]
    return QuadraticProgram(
        P=hessian,
        q=linear,
        C=jnp.concatenate([friction, motors]),
        low=jnp.concatenate([low, -limit - offset]),
        high=jnp.concatenate([high, limit - offset]),
        blocks=(("contact force", FRICTION_ROWS * contacts), ("torque", legs)),
    )


def motor_torques(actuation: Actuation, dynamics: Dynamics, unknowns: Float[Array, " n"]) -> Float[Array, " nu"]:
    """Motor torques [N m] of a solution, within the motors' limits."""
    motors = actuation.motors_from_torques @ (dynamics.torque @ unknowns + dynamics.torque_offset)
    return jnp.clip(motors, -actuation.limits, actuation.limits)
