"""What a mesh file is taken for: up axis, floor, level, place and unevenness, by meshes turned and shaken by hand."""

import math
import sys

import numpy as np
import pytest
import trimesh
from trimesh.transformations import rotation_matrix

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.imported.mesh_file import read_mesh
from iwalker_jax.scenes.imported.mesh_frame import mesh_frame
from iwalker_jax.scenes.imported.user_scene import convert_user_scene
from tests.scenes.test_user_scene import clearance, furnished, walls

Z_TO = {
    "z": np.eye(4),
    "y": np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]),
    "x": np.array([[0.0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
}
"""Turns a mesh whose z is up into one whose other axis is."""


def closed_room():
    """A room with floor, ceiling and four walls, and a block in it."""
    return trimesh.util.concatenate(
        [trimesh.creation.box(bounds=[[0, 0, 0], [6, 5, 2.6]]), trimesh.creation.box(bounds=[[2, 2, 0], [2.5, 3, 0.6]])]
    )


def scan(spacing, noise, tilt):
    """The furnished room as a scanner sees it: triangles of one size, whose corners are off, on a floor that slopes."""
    room = furnished()
    points, faces = trimesh.remesh.subdivide_to_size(room.vertices, room.faces, spacing, max_iter=30)
    mesh = trimesh.Trimesh(points, faces)
    mesh.vertices = mesh.vertices + np.random.default_rng(0).normal(size=mesh.vertices.shape) * noise
    return mesh.apply_transform(rotation_matrix(math.radians(tilt), (1.0, 0.3, 0.0)))


@pytest.mark.parametrize("make", [furnished, closed_room])
@pytest.mark.parametrize(("axis", "file"), [(a, f) for a in "zyx" for f in ("a.obj", "a.stl", "a.glb", "a.ply")])
def test_the_axis_that_is_up_is_found_in_every_format(tmp_path, make, axis, file):
    """By hand: 6 x 5 m, 2.6 m high, whatever the file's axes are, and the axis is named."""
    make().apply_transform(Z_TO[axis]).export(tmp_path / file)
    mesh = read_mesh(tmp_path / file)
    frame = mesh_frame(tmp_path / file, mesh)
    assert frame.up == axis
    height = 2.6 if make is closed_room else 2.7  # with the slab
    np.testing.assert_allclose(np.sort(frame.size), (height, 5.0, 6.0), atol=1e-4)
    mesh.apply_transform(frame.T_scene_file)
    assert mesh.bounds[1, 2] == pytest.approx(2.6, abs=1e-4), "its floor is at 0"
    usual = "y" if file.endswith("glb") else "z"
    assert bool(frame.notes) == (axis != usual)


def test_the_axis_may_be_given(tmp_path):
    """Property: what has no floor is refused, unless it is said which axis is up."""
    walls().export(tmp_path / "walls.stl")
    with pytest.raises(InputError, match=r"no floor .*6\.0 x 5\.0 x 2\.6 m.* option up"):
        convert_user_scene(tmp_path / "walls.stl")
    walls().apply_transform(Z_TO["y"]).export(tmp_path / "turned.stl")
    user = convert_user_scene(tmp_path / "turned.stl", up="y")
    assert user.scene.bounds[3] - user.scene.bounds[1] == pytest.approx(5.0)
    assert "6.0 x 5.0 m and 2.6 m high with y up" in user.describe()
    assert "no floor was found, y = 0 is taken for it" in user.describe()
    with pytest.raises(InputError, match="no floor and its lowest point is at z"):
        walls().apply_translation((0, 0, 2)).export(tmp_path / "high.stl")
        convert_user_scene(tmp_path / "high.stl", up="z")


def test_a_floor_elsewhere_is_brought_to_zero(tmp_path):
    """By hand: the room on the third floor is the room on the ground, and it is said."""
    furnished().export(tmp_path / "low.stl")
    furnished().apply_translation((0, 0, 6.0)).export(tmp_path / "high.stl")
    low, high = (convert_user_scene(tmp_path / name) for name in ("low.stl", "high.stl"))
    np.testing.assert_allclose(high.scene.boxes, low.scene.boxes, atol=1e-5)
    assert "its floor was at 6.00 m" in high.describe() and "floor" not in low.describe()
    np.testing.assert_allclose(high.T_scene_file[:3, 3], (0, 0, -6), atol=1e-6)


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_sloping_floor_is_levelled(tmp_path, up):
    """By hand: a room tilted by 1 degree, on which 10 cm would be obstacles, has those of the level one."""
    scan(0.2, 0.0, 1.0).apply_transform(Z_TO[up]).export(tmp_path / "scan.ply")
    user = convert_user_scene(tmp_path / "scan.ply")
    assert "levelled by 1.0 degrees" in user.describe()
    free = np.array([[1.0, 1.0, 0.1], [5.0, 1.0, 0.1], [3.5, 4.0, 0.1], [1.0, 4.0, 0.1]])
    assert clearance(user.scene, free).min() > 0.5


def test_an_uneven_floor_is_no_obstacle_and_is_said(tmp_path):
    """By hand: noise of 1.5 cm on a scanned floor; the block and the walls stay, the floor stays free."""
    scan(0.15, 0.015, 1.0).export(tmp_path / "scan.ply")
    user = convert_user_scene(tmp_path / "scan.ply")
    assert "levelled by 1.0 degrees" in user.describe()
    noise = float(user.describe().split("uneven by ")[1].split(" cm")[0])
    assert noise == pytest.approx(1.5, rel=0.35) and user.lowest > 0.05
    floor = np.stack(np.meshgrid(np.linspace(0.5, 1.6, 12), np.linspace(0.5, 4.5, 40)), axis=-1).reshape(-1, 2)
    assert clearance(user.scene, np.column_stack([floor, np.full(len(floor), 0.06)])).min() > 0.1
    assert clearance(user.scene, np.array([[2.25, 2.5, 0.3], [0.0, 2.5, 1.0]])).max() < 0.1


def test_a_scene_far_away_is_moved_to_the_origin(tmp_path):
    """By hand: whole metres, the same solids, and it is said."""
    furnished().export(tmp_path / "near.stl")
    furnished().apply_translation((500, -300, 0)).export(tmp_path / "far.stl")
    near, far = (convert_user_scene(tmp_path / name) for name in ("near.stl", "far.stl"))
    assert "moved by -503, 298 m to the origin" in far.describe()
    np.testing.assert_allclose(far.shift, (-503, 298))
    np.testing.assert_allclose(far.scene.boxes[:, :2] - far.shift, near.scene.boxes[:, :2] + (500, -300), atol=1e-3)
    text = '<mujoco><worldbody><geom type="box" size=".2 .2 .2" pos="500 0 .2"/></worldbody></mujoco>'
    (tmp_path / "far.xml").write_text(text)
    model = convert_user_scene(tmp_path / "far.xml", bounds=(498.0, -2.0, 502.0, 2.0))
    np.testing.assert_allclose(model.scene.boxes[0, :2], 0, atol=1e-9)
    assert model.scene.bounds == (-2.0, -2.0, 2.0, 2.0)


@pytest.mark.parametrize("file", ["a.obj", "a.stl", "a.ply", "a.off"])
def test_names_in_any_encoding_need_no_other_package(tmp_path, monkeypatch, file):
    """Property: a Latin-1 letter in a comment or header is read with the packages that guess encodings absent."""
    furnished().export(tmp_path / file)
    data = (tmp_path / file).read_bytes()
    if file == "a.ply":
        data = data.replace(b"\nelement vertex", b"\ncomment B\xfcro\nelement vertex", 1)
    elif file == "a.stl":
        data = b"B\xfcro" + data[4:]
    elif file == "a.off":
        data = data.replace(b"\n", b" # B\xfcro\n", 1)
    else:
        data = b"# B\xfcro\nmtllib B\xfcro.mtl\n" + data
    (tmp_path / file).write_bytes(data)
    for name in ("chardet", "charset_normalizer"):
        monkeypatch.setitem(sys.modules, name, None)
    assert len(read_mesh(tmp_path / file).faces) == len(furnished().faces)


def test_a_cloud_of_points_is_refused_with_a_way_out(tmp_path):
    """Property: the sentence counts the points and names a reconstruction."""
    trimesh.PointCloud(np.random.default_rng(0).uniform(size=(50, 3))).export(tmp_path / "cloud.ply")
    with pytest.raises(InputError, match=r"50 points but no triangles.*make a mesh of it first"):
        read_mesh(tmp_path / "cloud.ply")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("rigid", ["true", "false"])
def test_soft_bodies_are_obstacles(tmp_path, rigid):
    """By hand: a cushion of 60 cm and a cloth lie where the model puts them, and a rope is named as left out."""
    flex = f'rigid="{rigid}" mass="1" radius=".02"'
    (tmp_path / "soft.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="0 0 1"/>'
        f'<flexcomp name="cushion" type="grid" count="5 5 5" spacing=".15 .15 .15" pos="2 0 .35" dim="3" {flex}/>'
        f'<flexcomp name="cloth" type="grid" count="5 5 1" spacing=".15 .15 .15" pos="5 0 .5" dim="2" {flex}/>'
        f'<flexcomp name="rope" type="grid" count="5 1 1" spacing=".15 .15 .15" pos="8 0 .5" dim="1" {flex}/>'
        "</worldbody></mujoco>"
    )
    user = convert_user_scene(tmp_path / "soft.xml")
    assert clearance(user.scene, np.array([[2.0, 0.0, 0.35], [1.72, 0.28, 0.5], [5.0, 0.0, 0.5]])).max() < 0.05
    assert clearance(user.scene, np.array([[3.5, 0.0, 0.4]]))[0] > 1
    assert "left out: the flexible line rope" in user.describe()
