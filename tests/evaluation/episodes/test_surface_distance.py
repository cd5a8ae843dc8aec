"""Distances between a walked body and the original surfaces of a user's scene, against exact and brute-force ones."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
import trimesh

from bruce_model import crouch_qpos
from iwalker_jax.evaluation.episodes.surface_distance import least_surface_distance, original_surface
from iwalker_jax.navigation.body_volume import body_clearance_at
from iwalker_jax.robot import load_robot_model
from iwalker_jax.scenes.imported.mesh_distance import mesh_clearance
from iwalker_jax.scenes.scene import Scene
from tests.scenes.test_user_scene import mesh_of

BOXES = [[1.2, 0.5, 0.6, 0.2, 0.3, 0.6, 0.4], [0.0, -0.8, 0.2, 0.6, 0.1, 0.2, 0.0]]
ROOM = Scene("room", "test", np.array(BOXES), np.array([[0.4, 1.1, 0.5, 0.2, 0.5]]), (-2, -2, 2, 2), None)


def states(count=20):
    """Along a curve between the obstacles, turning."""
    share = np.linspace(0, 1, count)
    qpos = np.tile(crouch_qpos(), (count, 1))
    qpos[:, 0], qpos[:, 1] = 0.75 * share, 0.3 * np.sin(3 * share)
    qpos[:, 3], qpos[:, 4:6], qpos[:, 6] = np.cos(share / 2), 0.0, np.sin(share / 2)
    return qpos


def exported(kind, folder):
    """The room as a mesh with a floor slab, or as a model."""
    if kind == "stl":
        mesh_of(ROOM).export(folder / "room.stl")
        return folder / "room.stl"
    geoms = "".join(
        f'<geom type="box" pos="{x} {y} {z}" size="{a} {b} {c}" euler="0 0 {yaw}"/>' for x, y, z, a, b, c, yaw in BOXES
    )
    column = '<geom type="plane" size="3 3 1"/><geom type="cylinder" pos=".4 1.1 .5" size=".2 .5"/>'
    (folder / "room.xml").write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{column}{geoms}</worldbody></mujoco>'
    )
    return folder / "room.xml"


@pytest.mark.parametrize("kind", ["stl", "xml"])
def test_distances_to_solids_are_those_of_the_converted_scene(bruce_mujoco, bruce_volume, tmp_path, kind):
    """Oracle: the analytic clearance of the same boxes and cylinders; the floor slab does not count."""
    surface = original_surface(exported(kind, tmp_path))
    robot, scene = load_robot_model(bruce_mujoco), ROOM.arrays()
    clearances = jax.jit(jax.vmap(lambda state: body_clearance_at(robot, bruce_volume, scene, state)))
    exact = clearances(jnp.asarray(states(), jnp.float32))
    assert 0.01 < float(exact.min()) < 0.3
    assert least_surface_distance(surface, bruce_volume, bruce_mujoco, states()) == pytest.approx(
        float(exact.min()), abs=2e-3
    )


def test_of_all_spheres_and_faces_the_nearest_count(bruce_mujoco, bruce_volume):
    """Oracle: trimesh's closest points for every sphere of every state on the faces of a torus."""
    torus = trimesh.creation.torus(0.35, 0.05).apply_translation((0.9, 0.5, 0.4))
    data, least = mujoco.MjData(bruce_mujoco), np.inf
    for state in states():
        data.qpos[:] = state
        mujoco.mj_kinematics(bruce_mujoco, data)
        for body, offset, radius in zip(*(np.asarray(leaf) for leaf in bruce_volume), strict=True):
            place = data.xpos[body] + data.xmat[body].reshape(3, 3) @ offset
            least = min(least, float(mesh_clearance(torus, place[None])[0]) - float(radius))
    assert least_surface_distance(torus, bruce_volume, bruce_mujoco, states()) == pytest.approx(least, abs=1e-6)


def test_nothing_near_is_infinitely_far(bruce_mujoco, bruce_volume):
    far = trimesh.creation.box(bounds=[[5, 5, 0.1], [6, 6, 1]])
    assert least_surface_distance(far, bruce_volume, bruce_mujoco, states(2)) == np.inf
