"""Kinematics and equations of motion of a floating base with hinges, without recursions except for the poses.

With the poses known, everything else is a sum over kinematic chains, and chains are constant matrices. Spatial vectors
are [angular, linear] in world axes about the base's origin; velocity k moves the bodies of its chain along the axis
s_k. With C the chains and v the velocities, a body moves with C (s v); axes turn at (s v) x s; the composite inertia
that velocity k moves is C' I; M_kj = s_j . I_k s_k for j before k in the chain; and the bias is s . C' (I a + v x I v)
with a = C (s_dot v) - g. Featherstone, "Rigid Body Dynamics Algorithms" (2008), chapters 2, 5 and 6.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.geometry import rotation_matrix
from iwalker_jax.robot.model import RobotModel
from iwalker_jax.robot.skeleton import Carried, Skeleton


class SmoothStages(NamedTuple):
    """Kinematics and equations of motion at a state; what controller and physics share.

    Attributes:
        qpos: (nq,) with a unit quaternion; qvel: (nv,).
        base_position: (3,) [m]; base_rotation: (3, 3) from base to world axes.
        mass: () [kg]; com: (3,) [m] of the whole robot; torso_com: (3,) [m] of the base body.
        axes: (nv, 6) motion axes, spatial vectors about the base's origin.
        drifts: (nv, 6) what each velocity adds to spatial accelerations at zero generalised acceleration.
        mass_matrix: (nv, nv) with reflected inertias; bias: (nv,).
        site_positions: (s, 3) [m] of contact points, feet and IMU; site_rotations: (s, 3, 3).
        geom_positions: (geoms, 3), geom_rotations: (geoms, 3, 3) of the geoms that can touch something.
    """

    qpos: Float[Array, " nq"]
    qvel: Float[Array, " nv"]
    base_position: Float[Array, "3"]
    base_rotation: Float[Array, "3 3"]
    mass: Float[Array, ""]
    com: Float[Array, "3"]
    torso_com: Float[Array, "3"]
    axes: Float[Array, "nv 6"]
    drifts: Float[Array, "nv 6"]
    mass_matrix: Float[Array, "nv nv"]
    bias: Float[Array, " nv"]
    site_positions: Float[Array, "s 3"]
    site_rotations: Float[Array, "s 3 3"]
    geom_positions: Float[Array, "geoms 3"]
    geom_rotations: Float[Array, "geoms 3 3"]


class _Inertia(NamedTuple):
    """Spatial inertias about the base's origin: rotational (n, 3, 3), mass times COM (n, 3) and mass (n,)."""

    rotational: Array
    first: Array
    mass: Array


def smooth_stages(robot: RobotModel, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> SmoothStages:
    """Kinematics and equations of motion at a state.

    Args:
        qpos: (nq,) base position [m] and quaternion (wxyz, any length), joint positions [rad].
        qvel: (nv,) base velocity [m/s world, rad/s base frame], joint velocities [rad/s].
    """
    skeleton, model = robot.skeleton, robot.model
    quaternion = qpos[3:7] / jnp.linalg.norm(qpos[3:7])
    qpos = jnp.concatenate([qpos[:3], quaternion, qpos[7:]])
    positions, rotations = _link_poses(skeleton, qpos)
    axes = _motion_axes(skeleton, positions, rotations)
    moved = axes * qvel[:, None]
    drifts = _motion_cross(skeleton.ancestors @ moved, axes) * qvel[:, None]
    # The base's linear velocity has fixed directions.
    drifts = drifts * (np.arange(qvel.size) >= 3)[:, None]
    inertias = _body_inertias(robot, positions, rotations)
    carrying = skeleton.chains[:, 5:].T
    composite = _Inertia(*(jnp.tensordot(carrying, part, 1) for part in inertias))
    mass_matrix = _mass_matrix(robot, axes, composite)
    weight = jnp.concatenate([jnp.zeros(3, qpos.dtype), model.opt.gravity])
    acceleration, velocity = skeleton.chains @ drifts - weight, skeleton.chains @ moved
    forces = _momenta(inertias, acceleration) + _force_cross(velocity, _momenta(inertias, velocity))
    bias = jnp.sum(axes * _by_velocity(carrying @ forces), axis=1)
    site_positions, site_rotations = _poses(positions, rotations, skeleton.sites, skeleton.site_links)
    geom_positions, geom_rotations = _poses(positions, rotations, skeleton.geoms, skeleton.geom_links)
    return SmoothStages(
        qpos=qpos,
        qvel=qvel,
        base_position=qpos[:3],
        base_rotation=rotations[0],
        mass=composite.mass[0],
        com=qpos[:3] + composite.first[0] / composite.mass[0],
        torso_com=qpos[:3] + inertias.first[0] / inertias.mass[0],
        axes=axes,
        drifts=drifts,
        mass_matrix=mass_matrix,
        bias=bias,
        site_positions=site_positions,
        site_rotations=site_rotations,
        geom_positions=geom_positions,
        geom_rotations=geom_rotations,
    )


def point_velocity(motion: Float[Array, "*#n 6"], arm: Float[Array, "*#n 3"]) -> Float[Array, "*n 3"]:
    """Velocity of a point at `arm` from the base's origin that moves with a spatial velocity; the same for axes."""
    return motion[..., 3:] + jnp.cross(motion[..., :3], arm)


def _link_poses(skeleton: Skeleton, qpos: Array) -> tuple[Float[Array, "links 3"], Float[Array, "links 3 3"]]:
    """World poses of all links, the fixed world last."""
    angles = qpos[7:] - skeleton.references
    x, y, z = skeleton.axes.T
    zero = jnp.zeros_like(x)
    cross = jnp.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    sine, versine = jnp.sin(angles)[:, None, None], 2 * jnp.sin(angles / 2)[:, None, None] ** 2
    turns = jnp.eye(3, dtype=x.dtype) + sine * cross + versine * _matmul(cross, cross)
    rotations, positions = [rotation_matrix(qpos[3:7])[None]], [qpos[None, :3]]
    order, level = [0], [0]
    while level:
        children = [k + 1 for k, parent in enumerate(skeleton.parents) if parent in level]
        if not children:
            break
        above = [level.index(skeleton.parents[child - 1]) for child in children]
        rotation, position = _rows(rotations[-1], above), _rows(positions[-1], above)
        hinges = [child - 1 for child in children]
        positions.append(position + _apply(rotation, _rows(skeleton.offsets, hinges)))
        rotations.append(_matmul(rotation, _rows(turns, hinges)))
        order, level = order + children, children
    places = [order.index(link) for link in range(len(order))] + [len(order)]
    rotations.append(jnp.eye(3, dtype=x.dtype)[None])
    positions.append(jnp.zeros((1, 3), x.dtype))
    return _rows(jnp.concatenate(positions), places), _rows(jnp.concatenate(rotations), places)


def _motion_axes(skeleton: Skeleton, positions: Array, rotations: Array) -> Float[Array, "nv 6"]:
    """Motion axes: the world's for the base's linear, the base's for its angular velocity, and the hinges'."""
    hinges = _apply(rotations[1:-1], skeleton.axes)
    hinges = jnp.concatenate([hinges, jnp.cross(positions[1:-1] - positions[0], hinges)], axis=1)
    nothing, one = jnp.zeros((3, 3), hinges.dtype), jnp.eye(3, dtype=hinges.dtype)
    linear = jnp.concatenate([nothing, one], axis=1)
    return jnp.concatenate([linear, jnp.concatenate([rotations[0].T, nothing], axis=1), hinges])


def _body_inertias(robot: RobotModel, positions: Array, rotations: Array) -> _Inertia:
    """Spatial inertias of the robot's bodies."""
    skeleton, ids = robot.skeleton, list(robot.skeleton.body_ids)
    mass, moments, center = (
        _rows(x, ids) for x in (robot.model.body_mass, robot.model.body_inertia, robot.model.body_ipos)
    )
    link = _rows(rotations, skeleton.body_links)
    local = skeleton.bodies.positions + _apply(skeleton.bodies.rotations, center)
    arm = _rows(positions, skeleton.body_links) - positions[0] + _apply(link, local)
    principal = _matmul(link, skeleton.principal_axes)
    rotational = _matmul(principal * moments[:, None], jnp.swapaxes(principal, 1, 2))
    square = jnp.sum(arm**2, axis=1)[:, None, None] * jnp.eye(3, dtype=arm.dtype)
    rotational = rotational + mass[:, None, None] * (square - arm[:, :, None] * arm[:, None])
    return _Inertia(rotational, mass[:, None] * arm, mass)


def _mass_matrix(robot: RobotModel, axes: Array, composite: _Inertia) -> Float[Array, "nv nv"]:
    """Mass matrix with the reflected inertias of joints and tendons."""
    momenta = _momenta(_Inertia(*map(_by_velocity, composite)), axes)
    chained = robot.skeleton.ancestors
    below = (momenta @ axes.T) * chained * np.tri(len(axes), dtype=bool)
    moments, model = robot.tendon_moments, robot.model
    reflected = jnp.diag(model.dof_armature) + moments.T @ (moments * model.tendon_armature[:, None])
    return below + jnp.where(np.tri(len(axes), k=-1, dtype=bool).T, below.T, 0) + reflected


def _momenta(inertia: _Inertia, motion: Float[Array, "n 6"]) -> Float[Array, "n 6"]:
    """Spatial momentum of an inertia in a motion, or force in an acceleration."""
    angular, linear = motion[:, :3], motion[:, 3:]
    spin = _apply(inertia.rotational, angular) + jnp.cross(inertia.first, linear)
    return jnp.concatenate([spin, inertia.mass[:, None] * linear - jnp.cross(inertia.first, angular)], axis=1)


def _motion_cross(velocity: Float[Array, "n 6"], axis: Float[Array, "n 6"]) -> Float[Array, "n 6"]:
    """Rate of a motion axis that is carried along."""
    spin, linear = velocity[:, :3], velocity[:, 3:]
    return jnp.concatenate(
        [jnp.cross(spin, axis[:, :3]), jnp.cross(spin, axis[:, 3:]) + jnp.cross(linear, axis[:, :3])], axis=1
    )


def _force_cross(velocity: Float[Array, "n 6"], momentum: Float[Array, "n 6"]) -> Float[Array, "n 6"]:
    """Rate of a momentum that is carried along."""
    spin, linear = velocity[:, :3], velocity[:, 3:]
    return jnp.concatenate(
        [jnp.cross(spin, momentum[:, :3]) + jnp.cross(linear, momentum[:, 3:]), jnp.cross(spin, momentum[:, 3:])],
        axis=1,
    )


def _poses(
    positions: Array, rotations: Array, carried: Carried, links: tuple[int, ...]
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3 3"]]:
    """World poses of carried frames."""
    rotation = _rows(rotations, links)
    return _rows(positions, links) + _apply(rotation, carried.positions), _matmul(rotation, carried.rotations)


def _by_velocity(links: Float[Array, " links *k"]) -> Float[Array, " nv *k"]:
    """Values of links by velocity; the base's six share one."""
    return jnp.concatenate([jnp.broadcast_to(links[:1], (5, *links.shape[1:])), links])


def _matmul(a: Float[Array, "n 3 3"], b: Float[Array, "n 3 3"]) -> Float[Array, "n 3 3"]:
    """Products of small matrices, written out because XLA's batched product is slower at this size."""
    return a[:, :, 0, None] * b[:, None, 0] + a[:, :, 1, None] * b[:, None, 1] + a[:, :, 2, None] * b[:, None, 2]


def _apply(a: Float[Array, "n 3 3"], x: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Products of small matrices and vectors."""
    return a[:, :, 0] * x[:, 0, None] + a[:, :, 1] * x[:, 1, None] + a[:, :, 2] * x[:, 2, None]


def _rows(array: Float[Array, " n *k"], chosen: list[int] | tuple[int, ...]) -> Float[Array, " m *k"]:
    """Rows of an array; -1 is the last one. Neighbours are sliced, which costs nothing."""
    chosen = [index % array.shape[0] for index in chosen]
    first = chosen[0]
    if chosen == list(range(first, first + len(chosen))):
        return array[first : first + len(chosen)]
    return jnp.stack([array[index] for index in chosen])
