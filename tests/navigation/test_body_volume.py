"""The body as spheres: they fill the robot's geoms, and distances are those of C MuJoCo between the geoms."""

from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from bruce_model import mjcf_text
from iwalker_jax.errors import InputError
from iwalker_jax.navigation.body_volume import TOLERANCE, body_clearance, body_clearance_at, load_body_volume
from iwalker_jax.robot import load_robot_model
from iwalker_jax.scenes.built.held_out_sequences import held_out_sequence
from iwalker_jax.scenes.mjcf import scene_to_mjcf
from iwalker_jax.scenes.scene import Scene
from tests.gradients import assert_gradients_agree


@pytest.fixture(scope="module")
def clearance(bruce_mujoco, bruce_volume):
    robot = load_robot_model(bruce_mujoco)
    return jax.jit(lambda scene, qpos: body_clearance_at(robot, bruce_volume, scene, qpos))


def poses(model, count: int, seed: int) -> np.ndarray:
    """Random postures within the joints' ranges, tilted, near obstacles of the office."""
    rng = np.random.default_rng(seed)
    qpos = np.tile(model.key_qpos[0], (count, 1))
    qpos[:, 0:2] = rng.uniform([0.4, 0.4], [9.0, 7.5], size=(count, 2))
    qpos[:, 2] += rng.uniform(-0.05, 0.1, count)
    qpos[:, 3:7] = [1, 0, 0, 0] + rng.normal(size=(count, 4)) * [0.2, 0.1, 0.1, 1.0]
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    low, high = model.jnt_range[1:].T
    qpos[:, 7:] = np.clip(qpos[:, 7:] + rng.normal(size=(count, model.nq - 7)) * 0.3, low, high)
    return qpos


def with_scene(scene: Scene) -> mujoco.MjModel:
    """The robot in a scene, without floor and ceiling."""
    parts = ElementTree.fromstring(scene_to_mjcf(scene)).find("worldbody")
    boxes = "".join(
        ElementTree.tostring(geom, encoding="unicode") for geom in parts if geom.get("name") not in ("floor", "ceiling")
    )
    return mujoco.MjModel.from_xml_string(mjcf_text(floor=False, worldbody_xml=boxes.replace('material="wall"', "")))


def geom_distance(oracle, data, geom, solid):
    """Signed distance [m] between two geoms: C MuJoCo, and NumPy on the axis where its capsule against a box errs."""
    if oracle.geom_type[geom] != mujoco.mjtGeom.mjGEOM_CAPSULE or oracle.geom_type[solid] != mujoco.mjtGeom.mjGEOM_BOX:
        return mujoco.mj_geomDistance(oracle, data, geom, solid, 1.0, None)
    axis = data.geom_xmat[geom].reshape(3, 3)[:, 2]
    points = data.geom_xpos[geom] + np.linspace(-1, 1, 201)[:, None] * axis * oracle.geom_size[geom, 1]
    beyond = np.abs((points - data.geom_xpos[solid]) @ data.geom_xmat[solid].reshape(3, 3)) - oracle.geom_size[solid]
    outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
    return (outside + np.minimum(beyond.max(axis=1), 0)).min() - oracle.geom_size[geom, 0]


@pytest.mark.parametrize("name", ["office", "stair"])
def test_distances_are_those_of_c_mujoco(clearance, bruce_mujoco, name):
    """Oracle: `mj_geomDistance` of the volume's geoms against every obstacle, in postures outside and just inside."""
    scene = held_out_sequence(name).scene
    oracle = with_scene(scene)
    data = mujoco.MjData(oracle)
    body = [g for g in range(oracle.ngeom) if oracle.geom_group[g] in (2, 3)]
    solids = [g for g in range(oracle.ngeom) if oracle.geom_bodyid[g] == 0]
    arrays, errors = scene.arrays(), []
    for qpos in poses(bruce_mujoco, 80, seed=1):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(oracle, data)
        exact = min(geom_distance(oracle, data, geom, solid) for solid in solids for geom in body)
        got = float(clearance(arrays, jnp.asarray(qpos, jnp.float32)))
        if exact >= 1.0:
            assert got > 1.0 - 0.015
        elif exact > -0.02:
            errors.append(got - exact)
        else:
            assert got < 0
    assert len(errors) > 25
    assert np.abs(errors).max() < 0.015


def test_spheres_keep_the_tolerance(bruce_mujoco, bruce_volume):
    """Oracle: NumPy, from random points in every geom to the spheres and from the spheres' skin to the geoms."""
    data = mujoco.MjData(bruce_mujoco)
    mujoco.mj_forward(bruce_mujoco, data)
    bodies = np.asarray(bruce_volume.bodies)
    for body in set(bodies.tolist()):
        mine = bodies == body
        offsets, radii = np.asarray(bruce_volume.offsets)[mine], np.asarray(bruce_volume.radii)[mine]
        geoms = [g for g in range(bruce_mujoco.ngeom) if bruce_mujoco.geom_bodyid[g] == body]
        points = np.concatenate([surface_points(bruce_mujoco, g) for g in geoms])
        short = (np.linalg.norm(points[:, None] - offsets, axis=-1) - radii).min(axis=1)
        assert short.max() <= TOLERANCE + 1e-6
        rng = np.random.default_rng(body)
        ways = rng.normal(size=(300, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        skin = (offsets[:, None] + radii[:, None, None] * ways).reshape(-1, 3)
        beyond = np.min([distance_to_geom(bruce_mujoco, g, skin) for g in geoms], axis=0)
        assert beyond.max() <= TOLERANCE + 1e-6


def local(model, geom, points):
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    return (points - model.geom_pos[geom]) @ rotation.reshape(3, 3)


def distance_to_geom(model, geom, points):
    """Distance [m] from points in the body's frame to a geom, zero inside."""
    p, size = local(model, geom, points), model.geom_size[geom]
    radial = np.hypot(p[:, 0], p[:, 1])
    match mujoco.mjtGeom(model.geom_type[geom]):
        case mujoco.mjtGeom.mjGEOM_BOX:
            return np.linalg.norm(np.maximum(np.abs(p) - size, 0), axis=1)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return np.hypot(np.maximum(radial - size[0], 0), np.maximum(np.abs(p[:, 2]) - size[1], 0))
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return np.maximum(np.hypot(radial, np.maximum(np.abs(p[:, 2]) - size[1], 0)) - size[0], 0)
        case _:
            return np.maximum(np.linalg.norm(p, axis=1) - size[0], 0)


def surface_points(model, geom):
    """Points in the body's frame that lie on or in a geom, its corners and rims among them."""
    rng, size = np.random.default_rng(geom), model.geom_size[geom]
    reach = {mujoco.mjtGeom.mjGEOM_BOX: size}.get(model.geom_type[geom], np.full(3, size[0] + size[1]))
    local_points = reach * np.concatenate([rng.uniform(-1, 1, (4000, 3)), np.sign(rng.normal(size=(50, 3)))])
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    points = local_points @ rotation.reshape(3, 3).T + model.geom_pos[geom]
    return points[distance_to_geom(model, geom, points) <= 1e-9]


def test_gradients_of_positions_and_rotations(x64, bruce_mujoco, bruce_volume):
    """Oracle: central differences, outside and inside obstacles."""
    data = mujoco.MjData(bruce_mujoco)
    mujoco.mj_forward(bruce_mujoco, data)
    rotations = jnp.asarray(data.xmat.reshape(-1, 3, 3))
    boxes = np.array([[0.4, 0.1, 0.3, 0.1, 0.2, 0.3, 0.3], [2.0, 0.0, 0.5, 0.2, 0.2, 0.5, 0.0]])
    scene = Scene("two", "test", boxes, np.array([[-0.4, 0.0, 0.2, 0.1, 0.2]]), (-3.0, -3.0, 3.0, 3.0)).arrays()
    clearance = jax.jit(lambda p, r: body_clearance(bruce_volume, p, r, scene))
    for shift in ([0.0, 0.02, 0.0], [0.22, 0.07, 0.0], [-0.4, 0.01, 0.0]):
        positions = jnp.asarray(data.xpos + shift)
        assert_gradients_agree(clearance, positions, rotations)


def test_an_empty_scene_is_far_and_has_finite_gradients(bruce_mujoco, bruce_volume):
    """Property: without obstacles the clearance is huge and its derivatives are numbers."""
    scene = Scene("empty", "test", np.empty((0, 7)), np.empty((0, 5)), (-3.0, -3.0, 3.0, 3.0)).arrays()
    positions, rotations = jnp.zeros((bruce_mujoco.nbody, 3)), jnp.tile(jnp.eye(3), (bruce_mujoco.nbody, 1, 1))
    value, slope = jax.jit(jax.value_and_grad(body_clearance, argnums=1))(bruce_volume, positions, rotations, scene)
    assert value > 100.0
    assert bool(jnp.isfinite(slope).all())


def test_a_batch_equals_its_members(clearance, bruce_mujoco):
    """Property: vmap changes nothing."""
    scene = held_out_sequence("corner").scene.arrays()
    qpos = jnp.asarray(poses(bruce_mujoco, 3, seed=2), jnp.float32)
    together = jax.jit(jax.vmap(clearance, in_axes=(None, 0)))(scene, qpos)
    np.testing.assert_allclose(together, [clearance(scene, one) for one in qpos], atol=1e-6)


@pytest.mark.parametrize(
    ("geom", "message"),
    [
        ('<geom type="ellipsoid" size=".1 .1 .2" group="2"/>', "build its volume of boxes"),
        ('<geom type="cylinder" size=".3 .2" group="2"/>', "too thick"),
        ('<geom type="box" size=".3 .2 .1" group="0" contype="0" conaffinity="0"/>', "no geoms in group"),
    ],
)
def test_bodies_that_cannot_be_filled_are_refused(geom, message):
    """Property: one sentence says which geom is wrong."""
    robot = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body>{geom}</body></worldbody></mujoco>")
    with pytest.raises(InputError, match=message):
        load_body_volume(robot)
