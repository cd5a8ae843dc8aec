"""MuJoCo's rows of joint limits and foot contacts at a state: Jacobian, stiffness and reference acceleration.

A row's impedance d(x) rises from d_min to d_max with its violation x; with the regularisation R = (1 - d) / d A, A the
row's inverse inertia at rest, the stiffness is 1 / R and the reference acceleration a = -b J v - k d x, spring k and
damper b from solref. MuJoCo documentation, "Computation", section "Constraint model".
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.robot.contact.solver import ContactProblem
from iwalker_jax.robot.dynamics import SmoothStages
from iwalker_jax.robot.engine import mjx
from iwalker_jax.robot.model import RobotModel

_LEAST = float(mujoco.mjMINVAL)


def find_contacts(robot: RobotModel, data: SmoothStages) -> mjx.Contact:
    """MJX's contacts of the geoms that can touch something."""
    model, ids = robot.model, robot.skeleton.geom_ids
    places = np.zeros(model.ngeom, int)
    places[list(ids)] = range(len(ids))
    placed = mjx.make_data(model, impl="jax").replace(
        geom_xpos=data.geom_positions[places], geom_xmat=data.geom_rotations[places]
    )
    return mjx.collision(model, placed)._impl.contact


def contact_problem(
    robot: RobotModel, data: SmoothStages, contact: mjx.Contact, force: Float[Array, " nv"]
) -> ContactProblem:
    """The contact problem at a state with smooth forces `force`."""
    return ContactProblem(data.mass_matrix, force, *_limit_rows(robot, data), *_contact_rows(robot, data, contact))


def pyramid_edges(contact: mjx.Contact) -> Float[Array, "contacts 4 3"]:
    """Edges n + mu t, n - mu t of each contact's friction pyramid in its two tangents; world axes."""
    normal, tangents = contact.frame[:, 0], contact.frame[:, 1:]
    sides = contact.friction[:, :2, None] * tangents
    return normal[:, None] + jnp.stack([sides[:, 0], -sides[:, 0], sides[:, 1], -sides[:, 1]], axis=1)


def _limit_rows(robot: RobotModel, data: SmoothStages) -> tuple[Array, Array, Array]:
    """Signs, stiffness and reference of the joints' limits."""
    model = robot.model
    position, velocity, joints = data.qpos[7:], data.qvel[6:], slice(1, None)
    above, below = position - model.jnt_range[joints, 0], model.jnt_range[joints, 1] - position
    signs = jnp.where(above < below, 1.0, -1.0).astype(position.dtype)
    distance = jnp.minimum(above, below) - model.jnt_margin[joints]
    violated = (distance < 0) & jnp.asarray(model.jnt_limited[joints], bool)
    stiffness, spring, damper = _regularise(
        robot, distance, model.dof_invweight0[6:], model.jnt_solref[joints], model.jnt_solimp[joints]
    )
    return signs, jnp.where(violated, stiffness, 0), -damper * signs * velocity - spring * distance


def _contact_rows(robot: RobotModel, data: SmoothStages, contact: mjx.Contact) -> tuple[Array, Array, Array]:
    """Jacobian, stiffness and reference of the contacts' pyramid edges; every contact has one body of the world's."""
    model, skeleton = robot.model, robot.skeleton
    bodies = np.asarray([body for body, _ in robot.contact_bodies])
    sides = jnp.asarray([side for _, side in robot.contact_bodies], contact.pos.dtype)
    edges = sides[:, None, None] * pyramid_edges(contact)
    arms = (contact.pos - data.base_position)[:, None]
    wrenches = jnp.concatenate([jnp.cross(arms, edges), edges], axis=-1)
    chains = jnp.stack([skeleton.chains[skeleton.body_ids.index(body)] for body in bodies])
    rows = (wrenches.reshape(-1, 6) @ data.axes.T) * jnp.repeat(chains, 4, axis=0)
    distance = contact.dist - contact.includemargin
    friction = contact.friction[:, 0] ** 2
    # All edges share the regularisation of the first.
    weight = model.body_invweight0[bodies, 0] * (1 + friction) * 2 * friction / model.opt.impratio
    stiffness, spring, damper = _regularise(robot, distance, weight, contact.solref, contact.solimp)
    stiffness = jnp.where(distance < 0, stiffness, 0)
    reference = -jnp.repeat(damper, 4) * (rows @ data.qvel) - jnp.repeat(spring * distance, 4)
    return rows, jnp.repeat(stiffness, 4), reference


def _regularise(
    robot: RobotModel,
    distance: Float[Array, " n"],
    inverse_inertia: Float[Array, " n"],
    solref: Float[Array, "n 2"],
    solimp: Float[Array, "n 5"],
) -> tuple[Array, Array, Array]:
    """Stiffness, spring (with the impedance) and damper of rows; impedances rise quadratically."""
    low, high = (jnp.clip(solimp[:, k], mujoco.mjMINIMP, mujoco.mjMAXIMP) for k in (0, 1))
    width, middle = jnp.maximum(solimp[:, 2], _LEAST), jnp.clip(solimp[:, 3], mujoco.mjMINIMP, mujoco.mjMAXIMP)
    depth = jnp.minimum(jnp.abs(distance) / width, 1)
    rise = jnp.where(depth < middle, depth**2 / middle, 1 - (1 - depth) ** 2 / (1 - middle))
    impedance = low + rise * (high - low)
    stiffness = 1 / jnp.maximum(inverse_inertia * (1 - impedance) / impedance, _LEAST)
    # Positive solref: time constant, at least two time steps, and damping ratio; negative: spring and damper.
    time = jnp.maximum(solref[:, 0], 2 * robot.time_step)
    direct = solref[:, 0] <= 0
    spring = jnp.where(direct, -solref[:, 0] / high**2, 1 / (high * time * jnp.where(direct, 1, solref[:, 1])) ** 2)
    damper = jnp.where(solref[:, 1] <= 0, -solref[:, 1] / high, 2 / (high * time))
    return stiffness, spring * impedance, damper
