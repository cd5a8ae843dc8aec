"""The geoms of a user's MJCF as boxes, upright cylinders and meshes."""

import math
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float

from iwalker_jax.errors import InputError
from iwalker_jax.scenes.imported.named_files import check_model_files, require_file

_GEOM = mujoco.mjtGeom
_UPRIGHT = 1 - 1e-6
_WALL = 0.1
"""[m] thickness of the box that stands for a vertical plane."""


@dataclass
class MjcfSolids:
    """What a model consists of, in its world frame at its reference positions.

    Attributes:
        boxes, cylinders: rows of `Scene.boxes` and `Scene.cylinders`.
        meshes: everything else.
        ceiling: [m] height of a downward plane, if there is one.
        left_out: what the model has that is no obstacle here, in words.
    """

    boxes: list[list[float]] = field(default_factory=list)
    cylinders: list[list[float]] = field(default_factory=list)
    meshes: list[trimesh.Trimesh] = field(default_factory=list)
    ceiling: float | None = None
    left_out: list[str] = field(default_factory=list)


def load_mjcf(path: str | PathLike) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Model and data of an MJCF file with positions computed, ready for `mujoco_ray_depth`.

    Raises:
        InputError: there is no such file, it names a pipe, socket or device, or MuJoCo refuses it.
    """
    file = Path(path)
    require_file(file, "an MJCF model")
    check_model_files(file)
    try:
        model = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"MuJoCo cannot load {file} ({reason}); correct the model.") from error
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def solids_of_mjcf(model: mujoco.MjModel, data: mujoco.MjData, reach: float) -> MjcfSolids:
    """The geoms of a model as solids.

    Args:
        model, data: as from `load_mjcf`.
        reach: [m] half length of vertical planes without end.

    Raises:
        InputError: for a floor that is not at z = 0, a tilted plane, or a kind of geom without triangles.
    """
    solids = MjcfSolids()
    for geom in range(model.ngeom):
        rotation, position = data.geom_xmat[geom].reshape(3, 3), data.geom_xpos[geom]
        size, kind = model.geom_size[geom], _GEOM(model.geom_type[geom])
        upright = abs(rotation[2, 2]) >= _UPRIGHT
        if kind == _GEOM.mjGEOM_PLANE:
            _add_plane(solids, model.geom(geom).name or str(geom), rotation, position, size, reach)
        elif kind == _GEOM.mjGEOM_BOX and (np.abs(rotation[2]) >= _UPRIGHT).any():
            solids.boxes.append(_box_row(rotation, position, size))
        elif kind == _GEOM.mjGEOM_CYLINDER and upright:
            solids.cylinders.append([*position, size[0], size[1]])
        else:
            mesh = _mesh(model, geom, kind)
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = rotation, position
            solids.meshes.append(mesh.apply_transform(pose))
    for flex in range(model.nflex):
        _add_flex(solids, model, data, flex)
    for count, name in ((model.nskin, "skins"), (model.ntendon, "tendons")):
        if count:
            solids.left_out.append(f"{count} {name}")
    return solids


def _add_flex(solids: MjcfSolids, model: mujoco.MjModel, data: mujoco.MjData, flex: int) -> None:
    """A soft body as its surface in the shape that it has at the reference; one of lines alone is left out."""
    first, count = model.flex_vertadr[flex], model.flex_vertnum[flex]
    vertices = data.flexvert_xpos[first : first + count]
    if model.flex_dim[flex] == 3:
        start, corners = model.flex_shelldataadr[flex], model.flex_shell
        faces = corners[start : start + 3 * model.flex_shellnum[flex]].reshape(-1, 3)
    elif model.flex_dim[flex] == 2:
        start, corners = model.flex_elemdataadr[flex], model.flex_elem
        faces = corners[start : start + 3 * model.flex_elemnum[flex]].reshape(-1, 3)
    else:
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, flex) or flex
        solids.left_out.append(f"the flexible line {name}")
        return
    solids.meshes.append(trimesh.Trimesh(vertices, faces))


def _box_row(rotation: Float[np.ndarray, "3 3"], position: Float[np.ndarray, "3"], half: np.ndarray) -> list[float]:
    """A box with one edge upright, whichever of its own axes that is."""
    vertical = int(np.argmax(np.abs(rotation[2])))
    first, second = (vertical + 1) % 3, (vertical + 2) % 3
    yaw = math.atan2(rotation[1, first], rotation[0, first])
    return [*position, half[first], half[second], half[vertical], yaw]


def _add_plane(
    solids: MjcfSolids,
    name: str,
    rotation: Float[np.ndarray, "3 3"],
    position: Float[np.ndarray, "3"],
    size: Float[np.ndarray, "3"],
    reach: float,
) -> None:
    up = rotation[2, 2]
    if up >= _UPRIGHT:
        if abs(position[2]) > 1e-3:
            raise InputError(f"The floor {name} is at z = {position[2]:.3f} m; move the scene so that it is at z = 0.")
    elif up <= -_UPRIGHT:
        solids.ceiling = min(float(position[2]), solids.ceiling or math.inf)
    elif abs(up) <= 1e-6:
        half = np.where(size[:2] > 0, size[:2], reach)
        centre = position - rotation[:, 2] * _WALL / 2
        solids.boxes.append(_box_row(rotation, centre, np.array([*half, _WALL / 2])))
    else:
        raise InputError(f"The plane {name} is tilted, but the robot walks on level floors; replace it by a box.")


def _mesh(model: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom) -> trimesh.Trimesh:
    """A geom's surface in its own frame."""
    size = model.geom_size[geom]
    if kind == _GEOM.mjGEOM_BOX:
        return trimesh.creation.box(2 * size)
    if kind == _GEOM.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(size[0], 2 * size[1], sections=32)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(2 * size[1], size[0], count=[32, 32])
    if kind == _GEOM.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return trimesh.creation.icosphere(subdivisions=3).apply_scale(size)
    if kind == _GEOM.mjGEOM_MESH:
        data = model.mesh(model.geom_dataid[geom])
        vertices = model.mesh_vert[data.vertadr[0] : data.vertadr[0] + data.vertnum[0]]
        faces = model.mesh_face[data.faceadr[0] : data.faceadr[0] + data.facenum[0]]
        return trimesh.Trimesh(vertices, faces)
    name = model.geom(geom).name or geom
    raise InputError(f"The geom {name} is a {kind.name}; build the scene of boxes, cylinders, other solids and meshes.")
