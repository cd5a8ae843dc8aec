"""The robot's skeleton: every hinge a link, with constants read once in the reference posture.

A link's frame sits at its hinge's anchor and is parallel to the base when all joints are at their reference, so that
only hinge axes and offsets remain. Bodies, sites and geoms are carried by links: a body with several hinges by the
last of them, a body without hinges by what carries its parent. The base is link 0 and hinge k is link k + 1.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

WORLD = -1
"""The link that carries what is fixed in the world."""


class Carried(NamedTuple):
    """Frames that links carry.

    Attributes:
        positions: (n, 3) [m] and rotations: (n, 3, 3) in the link's frame.
    """

    positions: Float[Array, "n 3"]
    rotations: Float[Array, "n 3 3"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Skeleton:
    """Constants of the kinematics.

    Attributes:
        axes: (joints, 3) of the hinges.
        offsets: (joints, 3) from the parent link's origin to the hinge's anchor [m].
        references: (joints,) angles of the reference posture [rad].
        chains: (bodies, nv) 1 where a velocity moves a body of the robot, else 0; the base first.
        ancestors: (nv, nv) 1 where a column's velocity is the row's own or, earlier in the chain, moves its link.
        bodies: frames of the robot's bodies; principal_axes: (bodies, 3, 3) of their inertia in the link's frame.
        sites, geoms: frames of the sites and geoms that matter.
        parents: of each hinge's link.
        body_links, site_links, geom_links: what carries each of them.
        body_ids, geom_ids: their numbers in MuJoCo.
    """

    axes: Float[Array, "joints 3"]
    offsets: Float[Array, "joints 3"]
    references: Float[Array, " joints"]
    chains: Float[Array, "bodies nv"]
    ancestors: Float[Array, "nv nv"]
    bodies: Carried
    principal_axes: Float[Array, "bodies 3 3"]
    sites: Carried
    geoms: Carried
    parents: tuple[int, ...] = field(metadata={"static": True})
    body_links: tuple[int, ...] = field(metadata={"static": True})
    site_links: tuple[int, ...] = field(metadata={"static": True})
    geom_links: tuple[int, ...] = field(metadata={"static": True})
    body_ids: tuple[int, ...] = field(metadata={"static": True})
    geom_ids: tuple[int, ...] = field(metadata={"static": True})


def load_skeleton(model: mujoco.MjModel, sites: tuple[int, ...], geoms: tuple[int, ...]) -> Skeleton:
    """Read the skeleton of a robot with a free base and hinges, with some of its sites and geoms."""
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    mujoco.mj_kinematics(model, data)
    joints, base = model.njnt - 1, int(model.jnt_bodyid[0])
    links = _body_links(model)
    robot_bodies = tuple(int(body) for body in range(model.nbody) if links[body] != WORLD)
    anchors = np.concatenate([data.xpos[[base]], data.xanchor[1:]])
    parents = [
        k if model.body_jntadr[body] < k + 1 else links[model.body_parentid[body]]
        for k, body in enumerate(model.jnt_bodyid[1:])
    ]
    ancestors = np.zeros((model.nv, model.nv))
    ancestors[:6, :6] = 1
    for k, parent in enumerate(parents):
        ancestors[6 + k] = ancestors[5 + parent]
        ancestors[6 + k, 6 + k] = 1
    origins = np.concatenate([anchors, np.zeros((1, 3))])

    def carried(positions: np.ndarray, rotations: np.ndarray, ids: tuple[int, ...], by: list[int]) -> Carried:
        chosen = list(ids)
        return Carried(jnp.asarray(positions[chosen] - origins[by]), jnp.asarray(rotations[chosen].reshape(-1, 3, 3)))

    body_links = [links[body] for body in robot_bodies]
    site_links = [links[model.site_bodyid[site]] for site in sites]
    geom_links = [links[model.geom_bodyid[geom]] for geom in geoms]
    return Skeleton(
        axes=jnp.asarray(data.xaxis[1:]),
        offsets=jnp.asarray(anchors[1:] - anchors[parents]),
        references=jnp.asarray(model.qpos0[7 : 7 + joints]),
        chains=jnp.asarray(ancestors[[5 + link for link in body_links]]),
        ancestors=jnp.asarray(ancestors),
        bodies=carried(data.xpos, data.xmat, robot_bodies, body_links),
        principal_axes=jnp.asarray(data.ximat[list(robot_bodies)].reshape(-1, 3, 3)),
        sites=carried(data.site_xpos, data.site_xmat, sites, site_links),
        geoms=carried(data.geom_xpos, data.geom_xmat, geoms, geom_links),
        parents=tuple(parents),
        body_links=tuple(body_links),
        site_links=tuple(site_links),
        geom_links=tuple(geom_links),
        body_ids=robot_bodies,
        geom_ids=geoms,
    )


def _body_links(model: mujoco.MjModel) -> list[int]:
    """The link that carries each body."""
    links = [WORLD]
    for body in range(1, model.nbody):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        links.append(int(first + count - 1) if count else links[model.body_parentid[body]])
    return links
