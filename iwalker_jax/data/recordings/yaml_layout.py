"""Layout `yaml`: a folder of depth images, 16-bit PNG or .npy, and a `recording.yaml` that says what these do not."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from iwalker_jax.data.recordings.folder_files import (
    depth_images,
    inside,
    is_there,
    read_folder_text,
    read_numbers,
)
from iwalker_jax.data.recordings.metadata import RecordingMetadata, paired_rows
from iwalker_jax.data.recordings.plain_yaml import MAX_BYTES, parse_plain_yaml
from iwalker_jax.data.recordings.stored_depth import MILLIMETRE, NUMPY_SUFFIX
from iwalker_jax.errors import InputError
from iwalker_jax.perception import CameraMount, Intrinsics
from iwalker_jax.runtime import printable

FILE_NAME = "recording.yaml"
_KEYS = {"intrinsics", "depth_scale", "mount", "poses", "goals", "depth"}
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_MOUNT = ("height", "pitch_deg", "roll_deg", "forward", "left")
_MAX_OFFSET = 3.0  # [m] of the camera from the base's origin


def read_yaml_layout(folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None) -> RecordingMetadata:
    """Metadata of a folder with a `recording.yaml`, or of a bare folder of images whose intrinsics are given.

    Keys of the file: `intrinsics` {width, height, fx, fy, cx, cy} [px]; `depth_scale` [m per unit, 0.001 if absent]
    of PNG images, while .npy files hold metres; optional `mount` {height, forward, left [m], pitch_deg (down +),
    roll_deg (right side down +)}; optional `poses`, rows [x m, y m, yaw rad] of the base in the world, inline or the
    name of a text file; optional `goals`, rows [x, y] [m] in each frame's base frame, likewise; optional `depth`, the
    images' subfolder. Files and subfolder lie in the folder.

    Args:
        folder: of the recording.
        intrinsics, depth_scale: given by the caller; they win over the file.

    Raises:
        InputError: if the file is malformed or says too little.
    """
    content = _read_yaml(folder)
    assumptions: list[str] = []
    if intrinsics is None:
        intrinsics = _intrinsics(content)
    elif "intrinsics" in content:
        assumptions.append(f"The intrinsics given by the caller are used instead of those in {FILE_NAME}.")
    images, about_images = images_of(_image_folder(folder, content))
    assumptions += about_images
    in_metres = bool(images) and images[0].suffix.lower() == NUMPY_SUFFIX
    if in_metres:
        depth_scale = _scale_of_metres(content, depth_scale)
    elif depth_scale is None:
        if "depth_scale" in content:
            depth_scale = _number(content["depth_scale"], "depth_scale")
        else:
            depth_scale = 0.001
            assumptions.append("No depth scale is given: one unit is taken as 1 mm.")
    elif "depth_scale" in content:
        assumptions.append(f"The depth scale given by the caller is used instead of the one in {FILE_NAME}.")
    metadata = RecordingMetadata("yaml", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    mount = _mount(content["mount"]) if "mount" in content else None
    tables = {
        key: _rows(folder, content, key, width, what)
        for key, width, what in (("poses", 3, "x y yaw of each frame"), ("goals", 2, "x y of each frame's goal"))
        if key in content
    }
    paired = paired_rows(metadata, tables)
    metadata.poses, metadata.goals = paired.get("poses"), paired.get("goals")
    if mount is not None:
        metadata.mounts = np.tile(mount, (len(metadata.images), 1))
    return metadata


def images_of(folder: Path) -> tuple[list[Path], list[str]]:
    """(images of a folder in order, what was assumed): PNG files, or .npy files if there are none.

    Raises:
        InputError: as `depth_images`.
    """
    images, about_names = depth_images(folder)
    if images:
        return images, about_names
    images, about_names = depth_images(folder, NUMPY_SUFFIX)
    metres = ["Depth in .npy files is in metres, and kept to the millimetre."] if images else []
    return images, [*about_names, *metres]


def _scale_of_metres(content: dict[str, Any], given: float | None) -> float:
    """[m] per unit of images that are stored in metres, which no other scale may contradict."""
    stated = content.get("depth_scale", 1.0) if given is None else given
    if stated != 1.0:
        raise InputError(
            f"Depth in .npy files is in metres, but depth_scale is {printable(stated)}; save metres and leave it out."
        )
    return MILLIMETRE


def _read_yaml(folder: Path) -> dict[str, Any]:
    if not is_there(folder / FILE_NAME):
        return {}
    text = read_folder_text(folder, FILE_NAME, MAX_BYTES)
    try:
        content = parse_plain_yaml(text)
    except InputError as error:
        raise InputError(f"{FILE_NAME} {error}") from None
    if not isinstance(content, dict):
        raise InputError(f"{FILE_NAME} must hold keys such as intrinsics and depth_scale.")
    unknown = sorted(str(key) for key in set(content) - _KEYS)
    if unknown:
        raise InputError(
            f"{FILE_NAME} has unknown keys {printable(', '.join(unknown))}; known are {', '.join(sorted(_KEYS))}."
        )
    return content


def _intrinsics(content: dict[str, Any]) -> Intrinsics:
    if "intrinsics" not in content:
        raise InputError(
            f"The intrinsics are unknown; write them into {FILE_NAME} (intrinsics: {{width, height, fx, fy, cx, cy}}) "
            "or give them as arguments."
        )
    values = _fields(content["intrinsics"], "intrinsics", _INTRINSICS, required=_INTRINSICS)
    width, height = values.pop("width"), values.pop("height")
    if not (width.is_integer() and height.is_integer()):
        raise InputError(f"{FILE_NAME}: width and height must be whole pixels, got {width:g} x {height:g}.")
    return Intrinsics(int(width), int(height), **values)


def _mount(entry: Any) -> Float[np.ndarray, " 5"]:
    """Camera mount array; what is not given is as in `CameraMount`, roll and left 0."""
    values = _fields(entry, "mount", _MOUNT, required=("height", "pitch_deg"))
    offsets = [values.get("forward", CameraMount.forward), values.get("left", 0.0)]
    if (
        not 0.05 < values["height"] < 5.0
        or abs(values["pitch_deg"]) > 85.0
        or abs(values.get("roll_deg", 0.0)) > 60.0
        or max(abs(offset) for offset in offsets) > _MAX_OFFSET
    ):
        raise InputError(
            f"The mount {values} in {FILE_NAME} cannot be; height, forward and left are in metres (the height above "
            "the floor), angles are in degrees."
        )
    angles = np.radians([values["pitch_deg"], values.get("roll_deg", 0.0)])
    return np.array([values["height"], *angles, *offsets])


def _fields(entry: Any, name: str, known: tuple[str, ...], required: tuple[str, ...]) -> dict[str, float]:
    if not isinstance(entry, dict) or set(entry) - set(known) or set(required) - set(entry):
        raise InputError(f"{FILE_NAME}: {name} needs {', '.join(required)} and knows {', '.join(known)}.")
    return {key: _number(value, f"{name}.{key}") for key, value in entry.items()}


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{FILE_NAME}: {name} must be a finite number, got {printable(repr(value))}.")
    return float(value)


def _image_folder(folder: Path, content: dict[str, Any]) -> Path:
    if "depth" in content:
        return inside(folder, content["depth"], f"{FILE_NAME}: depth")
    return folder / "depth" if (folder / "depth").is_dir() else folder


def _rows(
    folder: Path, content: dict[str, Any], key: str, width: int, what: str
) -> tuple[str, Float[np.ndarray, "m width"]]:
    """(file, rows) of `poses` or `goals`."""
    entry = content[key]
    if isinstance(entry, str):
        inside(folder, entry, f"{FILE_NAME}: {key}")
        file, rows = entry, read_numbers(folder, entry, (width,), what)
    else:
        file, rows = FILE_NAME, _inline_rows(entry, key, width)
    if not rows:
        raise InputError(f"{printable(file)} has no {key}; write {what}, or leave {key} out of {FILE_NAME}.")
    return file, np.array(rows, float)


def _inline_rows(entry: Any, key: str, width: int) -> list[list[float]]:
    if not isinstance(entry, list):
        raise InputError(f"{FILE_NAME}: {key} must be rows of {width} numbers or the name of a text file.")
    for number, row in enumerate(entry):
        plain = isinstance(row, list) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in row)
        if not plain or len(row) != width:
            raise InputError(
                f"{FILE_NAME}: {key} must be rows of {width} numbers or the name of a text file, but row {number} is "
                f"{printable(repr(row))}."
            )
    return entry
