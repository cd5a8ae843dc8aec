"""A user's own scenes: converted ones look and measure like the originals in C MuJoCo and trimesh."""

import math
import os

import mujoco
import numpy as np
import pytest
import trimesh
from trimesh.transformations import rotation_matrix, translation_matrix

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.scenes.imported.mesh_distance import mesh_clearance
from iwalker_jax.scenes.imported.mjcf_solids import load_mjcf
from iwalker_jax.scenes.imported.user_scene import convert_user_scene
from iwalker_jax.scenes.imported.voxel_boxes import sample_surface, voxel_boxes
from iwalker_jax.scenes.mjcf import load_mujoco_scene, mujoco_ray_depth, scene_to_mjcf
from iwalker_jax.tasks.named import demonstration

CAMERA = Intrinsics(80, 45, 40.0, 40.0, 39.5, 22.0)


def camera_at(x, y, yaw):
    """The robot's camera as rotation and position, worked out apart from the library."""
    mount = CameraMount()
    forward = np.array([math.cos(yaw) * math.cos(mount.pitch), math.sin(yaw) * math.cos(mount.pitch), 0])
    forward[2] = -math.sin(mount.pitch)
    right = np.array([math.sin(yaw), -math.cos(yaw), 0.0])
    return np.column_stack([right, np.cross(forward, right), forward]), np.array([x, y, mount.height])


def mesh_model(mesh):
    """MuJoCo model and data of a mesh on a floor at z = 0."""
    spec = mujoco.MjSpec()
    spec.add_material(name="wall")
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], material="wall")
    spec.add_mesh(
        name="scene",
        uservert=mesh.vertices.astype(np.float32).ravel(),
        userface=mesh.faces.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH, meshname="scene", material="wall", contype=0, conaffinity=0
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def share_within(model, scene, poses, tolerance):
    """Share of the original's pixels whose depth the converted scene shows within a tolerance [m]."""
    errors, converted = [], load_mujoco_scene(scene)
    for pose in poses:
        rotation, position = camera_at(*pose)
        original = mujoco_ray_depth(*model, CAMERA, rotation, position)
        errors.append(np.abs(mujoco_ray_depth(*converted, CAMERA, rotation, position) - original))
    return np.mean(np.array(errors) <= tolerance)


def clearance(scene, points):
    """Distance [m] from points to a scene's solids, zero inside."""
    nearest = np.full(len(points), np.inf)
    for x, y, z, hx, hy, hz, yaw in scene.boxes:
        turned = (points[:, 0] - x + 1j * (points[:, 1] - y)) * np.exp(-1j * yaw)
        beyond = np.abs(np.stack([turned.real, turned.imag, points[:, 2] - z])) - [[hx], [hy], [hz]]
        nearest = np.minimum(nearest, np.linalg.norm(np.maximum(beyond, 0), axis=0))
    for x, y, z, radius, half in scene.cylinders:
        radial = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
        nearest = np.minimum(nearest, np.hypot(np.maximum(radial, 0), np.maximum(np.abs(points[:, 2] - z) - half, 0)))
    return nearest


def mesh_of(scene):
    """A scene's solids on a floor slab as one mesh."""
    x_min, y_min, x_max, y_max = scene.bounds
    slab = trimesh.creation.box(bounds=[[x_min - 0.5, y_min - 0.5, -0.1], [x_max + 0.5, y_max + 0.5, 0.0]])
    parts = [slab]
    for *centre, hx, hy, hz, yaw in scene.boxes:
        parts.append(
            trimesh.creation.box((2 * hx, 2 * hy, 2 * hz), translation_matrix(centre) @ rotation_matrix(yaw, (0, 0, 1)))
        )
    for *centre, radius, half in scene.cylinders:
        parts.append(trimesh.creation.cylinder(radius, 2 * half, transform=translation_matrix(centre)))
    return trimesh.util.concatenate(parts)


def walls(turn=0.0):
    """Four walls without thickness around 6 x 5 m."""
    room = trimesh.creation.box(bounds=[[0, 0, 0], [6, 5, 2.6]])
    room = trimesh.Trimesh(room.vertices, room.faces[np.abs(room.face_normals[:, 2]) < 0.5])
    return room.apply_transform(rotation_matrix(turn, (0, 0, 1), (3, 2.5, 0)))


def furnished():
    """The walls on a floor, and a block in the room."""
    floor = trimesh.creation.box(bounds=[[0, 0, -0.1], [6, 5, 0]])
    return trimesh.util.concatenate([walls(), floor, trimesh.creation.box(bounds=[[2, 2, 0], [2.5, 3, 0.6]])])


def things():
    """Shapes that are neither upright boxes nor cylinders."""
    return [
        trimesh.creation.torus(0.4, 0.1).apply_translation((2.2, 1.2, 0.25)),
        trimesh.creation.icosphere(3, 0.35).apply_translation((4.2, 3.4, 0.4)),
        trimesh.creation.cone(0.3, 0.8).apply_translation((1.6, 3.9, 0.0)),
        trimesh.creation.box((1.4, 0.3, 0.1), translation_matrix((4, 1, 0.5)) @ rotation_matrix(0.5, (0, 1, 0))),
        trimesh.creation.cylinder(
            0.12, 1.6, transform=translation_matrix((5.2, 2.4, 0.3)) @ rotation_matrix(1.57, (1, 0, 0))
        ),
    ]


def inside_any(solids, points):
    """Whether points lie inside one of some closed meshes: their winding number, summed over solid angles."""
    inside = np.zeros(len(points), bool)
    for solid in solids:
        a, b, c = np.moveaxis(solid.triangles[None] - points[:, None, None], 2, 0)
        la, lb, lc = (np.linalg.norm(corner, axis=-1) for corner in (a, b, c))
        volume = np.sum(a * np.cross(b, c), axis=-1)
        spread = la * lb * lc + np.sum(a * b, -1) * lc + np.sum(b * c, -1) * la + np.sum(a * c, -1) * lb
        inside |= np.arctan2(volume, spread).sum(axis=1) > math.pi
    return inside


def test_solids_of_a_mesh_are_taken_over_exactly(tmp_path):
    """Oracle: C MuJoCo's rays on the mesh's triangles; the furniture of an office, exported as STL."""
    task = demonstration("office")
    mesh = mesh_of(task.scene)
    mesh.export(tmp_path / "office.stl")
    user = convert_user_scene(tmp_path / "office.stl", bounds=task.scene.bounds)
    assert (user.merged, user.discs) == (0, 0)
    # Also the plate of 3 cm that lies on the floor: feet do not clear it.
    assert (user.exact, user.low) == (len(task.scene.boxes) + len(task.scene.cylinders), 0)
    poses = [task.start, (2.0, 4.0, -0.5), (5.8, 4.2, 3.0)]
    assert share_within(mesh_model(mesh), user.scene, poses, 0.01) > 0.98
    user.scene.arrays()


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_other_shapes_keep_depth_and_clearance(tmp_path, turn):
    """Oracle: C MuJoCo's rays and trimesh's closest points on the triangles, within a voxel at 95 % and more."""
    mesh = trimesh.util.concatenate([walls(turn), *things()])
    mesh.export(tmp_path / "room.obj")
    user = convert_user_scene(tmp_path / "room.obj", up="z")
    assert user.exact == 0
    assert user.merged > 4
    assert user.discs > 10
    assert user.voxel <= 0.075
    assert user.error <= 1.5 * user.voxel
    poses = [(3.0, 2.4, yaw) for yaw in np.linspace(-3, 3, 8)]
    assert share_within(mesh_model(mesh), user.scene, poses, user.voxel) > 0.95
    points = np.random.default_rng(0).uniform([1.0, 1.0, 0.1], [5.0, 4.0, 1.2], size=(600, 3))
    exact = mesh_clearance(mesh, points)
    # Inside a closed solid the mesh's surface is away, but the scene is not.
    errors = np.abs(clearance(user.scene, points) - exact)[~inside_any(things(), points)]
    assert np.mean(errors <= user.voxel) > 0.95
    assert errors.max() < 2 * user.voxel
    assert "voxels of" in user.describe()


MODEL = """<mujoco>
  <compiler angle="radian"/>
  <asset><material name="wall"/><mesh name="wedge" vertex="0 0 0  .8 0 0  0 .6 0  0 0 .7"/></asset>
  <default><geom material="wall"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <geom type="plane" size="0 0 1" pos="0 0 2.5" euler="3.14159265358979 0 0"/>
    <geom type="plane" size="0 0 1" pos="-1 0 0" euler="0 1.5707963267949 0"/>
    <geom type="box" size=".1 .2 .3" pos="2 1 .2" euler="0 1.5707963267949 0"/>
    <geom type="box" size=".5 .2 .3" pos="2 -1.2 .3" euler="0 0 .7"/>
    <geom type="cylinder" size=".3 .4" pos="3.5 0 .4"/>
    <body pos="3 2 0" euler="0 0 .3">
      <joint type="hinge"/>
      <geom type="capsule" size=".15 .3" pos="0 0 .45"/>
      <geom type="sphere" size=".3" pos=".9 0 .3"/>
    </body>
    <geom type="box" size=".5 .15 .05" pos="4 -1.5 .4" euler="0 .5 0"/>
    <geom type="ellipsoid" size=".4 .2 .3" pos="5 1 .3"/>
    <geom type="mesh" mesh="wedge" pos="4.8 -.5 .35"/>
  </worldbody>
</mujoco>"""


def test_an_mjcf_model_looks_like_itself(tmp_path):
    """Oracle: C MuJoCo's rays on the original model; upright geoms exact, the rest within a voxel."""
    (tmp_path / "mine.xml").write_text(MODEL)
    user = convert_user_scene(tmp_path / "mine.xml")
    assert user.exact == 4
    assert user.scene.ceiling == pytest.approx(2.5)
    length, width, height, yaw = user.scene.boxes[1, 3:7]
    assert (length, width, height, abs(yaw)) == pytest.approx((0.2, 0.3, 0.1, math.pi / 2), abs=1e-6)
    poses = [(0.0, 0.0, yaw) for yaw in (-0.6, -0.2, 0.2, 0.6, 2.0, 3.1)] + [(3.6, 0.9, -1.0), (6.0, 0.0, 3.0)]
    assert share_within(load_mjcf(tmp_path / "mine.xml"), user.scene, poses, 0.05) > 0.95
    user.scene.arrays()


def test_an_exported_scene_comes_back(tmp_path):
    """Property: writing a scene as MJCF and loading it gives the same boxes and cylinders."""
    scene = demonstration("factory").scene
    (tmp_path / "hall.xml").write_text(scene_to_mjcf(scene))
    again = convert_user_scene(tmp_path / "hall.xml", bounds=scene.bounds).scene
    np.testing.assert_allclose(again.cylinders, scene.cylinders, atol=1e-9)
    np.testing.assert_allclose(again.boxes[:, :6], scene.boxes[:, :6], atol=1e-9)
    np.testing.assert_allclose(np.exp(1j * again.boxes[:, 6]), np.exp(1j * scene.boxes[:, 6]), atol=1e-9)
    assert again.ceiling == pytest.approx(scene.ceiling)


def test_gltf_is_y_up_and_bounds_cut(tmp_path):
    """Property: the same room as GLB and STL is the same scene; what lies outside the bounds is left out."""
    room = furnished()
    room.export(tmp_path / "room.stl")
    to_y_up = rotation_matrix(-math.pi / 2, (1, 0, 0))
    room.copy().apply_transform(to_y_up).export(tmp_path / "room.glb")
    flat, turned = convert_user_scene(tmp_path / "room.stl").scene, convert_user_scene(tmp_path / "room.glb").scene
    np.testing.assert_allclose(turned.bounds, flat.bounds, atol=1e-5)
    np.testing.assert_allclose(turned.boxes, flat.boxes, atol=1e-5)
    cut = convert_user_scene(tmp_path / "room.stl", bounds=(1.0, 1.0, 4.0, 4.0))
    assert (cut.exact, cut.merged) == (1, 0)


def test_a_closed_room_is_not_a_block(tmp_path):
    """Property: a room modelled as a closed box with outward faces becomes walls, its furniture solids."""
    room = trimesh.creation.box(bounds=[[0, 0, 0], [5, 4, 2.5]])
    trimesh.util.concatenate([room, trimesh.creation.box(bounds=[[2, 2, 0], [2.5, 3, 0.6]])]).export(tmp_path / "a.stl")
    scene = convert_user_scene(tmp_path / "a.stl").scene
    assert clearance(scene, np.array([[1.0, 1.0, 0.3]]))[0] > 0.9


def test_merged_voxels_cover_what_is_occupied():
    """Oracle: every surface point lies in a box, and every box near the surface, for a random heap of triangles."""
    rng = np.random.default_rng(4)
    corners = rng.uniform([0, 0, 0.2], [2, 2, 0.8], size=(6, 1, 3)) + rng.normal(size=(6, 3, 3)) * 0.2
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(18).reshape(-1, 3))
    band, bounds = (0.1, 0.9), (0.0, 0.0, 2.0, 2.0)
    surface = sample_surface(mesh, 0.025, band, bounds)
    merged = voxel_boxes([surface], 0.05, band, bounds, yaw=0.3)
    assert merged.error <= 0.05
    middles = merged.boxes[:, :3]
    assert mesh_clearance(mesh, middles).max() < 0.4
    assert voxel_boxes([surface], 0.05, band, bounds, most=3) is None


def stl(folder, mesh):
    path = folder / "scene.stl"
    mesh.export(path)
    return path


BAD = [
    ("no file", lambda folder: folder / "nowhere.stl"),
    ("no file", lambda folder: folder / "nowhere.xml"),
    ("unknown ending", lambda folder: folder / "scene.txt"),
    ("in millimetres", lambda folder: stl(folder, walls().apply_scale(1000))),
    ("give bounds with sides", lambda folder: stl(folder, furnished().apply_scale(15))),
    ("scale it to metres", lambda folder: stl(folder, walls().apply_scale(0.01))),
    ("no floor .* which way is up", lambda folder: stl(folder, walls().apply_translation((0, 0, 3)))),
    ("slopes by 10 degrees", lambda folder: stl(folder, furnished().apply_transform(rotation_matrix(0.17, (1, 0, 0))))),
    ("is a point cloud; make a mesh", lambda folder: folder / "scan.pcd"),
    ("export it as GLB", lambda folder: folder / "scene.dae"),
    ("nothing above its floor", lambda folder: stl(folder, trimesh.creation.box(bounds=[[0, 0, -0.1], [3, 3, 0]]))),
]


@pytest.mark.parametrize(("message", "make"), BAD)
def test_unusable_files_are_refused(tmp_path, message, make):
    """Property: one sentence says what is wrong with the file and what to do."""
    with pytest.raises(InputError, match=message):
        convert_user_scene(make(tmp_path))


@pytest.mark.parametrize(
    ("message", "text"),
    [
        ("MuJoCo cannot load", "<mujoco><worldbody><geom/></worldbody></mujoco>"),
        ("cannot load", "not xml"),
        ("nothing to walk around", '<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'),
        ("floor .* is at z", '<mujoco><worldbody><geom type="plane" size="1 1 1" pos="0 0 1"/></worldbody></mujoco>'),
        ("half size 3e\\+05", '<mujoco><worldbody><geom type="box" size="3e5 1 1"/></worldbody></mujoco>'),
        ("is tilted", '<mujoco><worldbody><geom type="plane" size="1 1 1" euler="20 0 0"/></worldbody></mujoco>'),
        (
            "8200 boxes",
            "<mujoco><worldbody>" + 8200 * '<geom type="box" size=".1 .1 .1" pos="0 0 .1"/>' + "</worldbody></mujoco>",
        ),
    ],
)
def test_unusable_models_are_refused(tmp_path, message, text):
    """Property: one sentence says what is wrong with the model."""
    (tmp_path / "model.xml").write_text(text)
    with pytest.raises(InputError, match=message):
        convert_user_scene(tmp_path / "model.xml")


@pytest.mark.parametrize("entry", [math.nan, math.inf])
def test_vertices_that_are_not_finite_are_not_taken_away_in_silence(tmp_path, entry):
    """Property: a mesh that has lost a corner is refused; its reader would leave out all triangles there."""
    mesh = furnished()
    vertices = np.array(mesh.vertices)
    vertices[3, 1] = entry
    with pytest.raises(InputError, match="not finite"):
        convert_user_scene(stl(tmp_path, trimesh.Trimesh(vertices, mesh.faces, process=False)))


def test_triangles_without_area_make_no_difference(tmp_path):
    """Oracle: the same scene without them; a point and a line that float in the air are no obstacles."""
    mesh = furnished()
    whole = convert_user_scene(stl(tmp_path, mesh))
    points = np.concatenate([mesh.vertices, mesh.vertices.mean(axis=0) + np.array([[0.5, 0.5, 0.9], [0.5, 0.7, 0.9]])])
    first, second = len(points) - 2, len(points) - 1
    faces = np.concatenate([mesh.faces, [[first] * 3, [first, first, second], [0, 0, 0]]])
    found = convert_user_scene(stl(tmp_path, trimesh.Trimesh(points, faces, process=False)))
    np.testing.assert_array_equal(found.scene.boxes, whole.scene.boxes)
    np.testing.assert_array_equal(found.scene.cylinders, whole.scene.cylinders)


@pytest.mark.parametrize(
    "part",
    [
        '<include file="pipe"/>',
        "<include file='&#112;ipe'/>",
        '<include file="inner.xml"/>',
        '<asset><mesh name="m" file="/dev/zero"/></asset>',
        '<compiler meshdir="/dev"/><asset><mesh name="m" file="zero"/></asset>',
    ],
)
def test_models_that_name_pipes_and_devices_are_refused(tmp_path, part):
    """Property: a sentence and no wait; MuJoCo would open them and never come back."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "inner.xml").write_text('<mujocoinclude><asset><hfield name="h" file="pipe"/></asset></mujocoinclude>')
    (tmp_path / "model.xml").write_text(f"<mujoco>{part}</mujoco>")
    with pytest.raises(InputError, match="a pipe, socket or device"):
        convert_user_scene(tmp_path / "model.xml")


def test_meshes_that_name_pipes_are_refused(tmp_path):
    """Property: a sentence and no wait; a .gltf file keeps its numbers in others."""
    os.mkfifo(tmp_path / "numbers.bin")
    (tmp_path / "scene.gltf").write_text('{"asset": {"version": "2.0"}, "buffers": [{"uri": "numbers%2Ebin"}]}')
    with pytest.raises(InputError, match="a pipe, socket or device"):
        convert_user_scene(tmp_path / "scene.gltf")


@pytest.mark.parametrize("options", [{"bounds": (0.0, 0.0, 1.0)}, {"bounds": (1.0, 0.0, 0.0, 1.0)}, {"up": "w"}])
def test_options_that_cannot_be_are_refused(tmp_path, options, unchecked_types):
    with pytest.raises(InputError, match=r"x_min, y_min, x_max, y_max|give x, y, z"):
        convert_user_scene(stl(tmp_path, furnished()), **options)


@pytest.mark.parametrize("name", ["scene.stl", "scene.obj", "scene.glb"])
def test_broken_meshes_are_refused(tmp_path, name):
    """Property: garbage and empty files give a sentence, not a parser's traceback."""
    for content in (b"", b"garbage \x00\x01"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=r"cannot be read|no triangles"):
            convert_user_scene(tmp_path / name)
