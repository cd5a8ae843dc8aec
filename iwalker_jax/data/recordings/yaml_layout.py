"""Layout `yaml`: a folder of 16-bit PNG depth images and one `recording.yaml` that says what the images do not."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from iwalker_jax.data.recordings.metadata import RecordingMetadata, read_numbers, sorted_images
from iwalker_jax.data.recordings.report import FileProblem
from iwalker_jax.errors import InputError
from iwalker_jax.perception import CameraMount, Intrinsics

FILE_NAME = "recording.yaml"
_KEYS = {"intrinsics", "depth_scale", "mount", "poses", "goals", "depth"}
_INTRINSICS = ("width", "height", "fx", "fy", "cx", "cy")
_MOUNT = ("height", "pitch_deg", "roll_deg", "forward", "left")


def read_yaml_layout(folder: Path, intrinsics: Intrinsics | None, depth_scale: float | None) -> RecordingMetadata:
    """Metadata of a folder with a `recording.yaml`, or of a bare folder of images whose intrinsics are given.

    Keys of the file: `intrinsics` {width, height, fx, fy, cx, cy} [px]; `depth_scale` [m per unit, 0.001 if absent];
    optional `mount` {height, forward, left [m], pitch_deg (down +), roll_deg (right side down +)}; optional `poses`,
    rows [x m, y m, yaw rad] of the base in the world, inline or the name of a text file; optional `goals`, rows [x, y]
    [m] in each frame's base frame, likewise; optional `depth`, the images' subfolder.

    Args:
        folder: of the recording.
        intrinsics, depth_scale: given by the caller; they win over the file.

    Raises:
        InputError: if the file is malformed or says too little.
    """
    content = _read_yaml(folder / FILE_NAME)
    assumptions: list[str] = []
    if intrinsics is None:
        intrinsics = _intrinsics(content)
    elif "intrinsics" in content:
        assumptions.append(f"The intrinsics given by the caller are used instead of those in {FILE_NAME}.")
    if depth_scale is None:
        if "depth_scale" in content:
            depth_scale = _number(content["depth_scale"], "depth_scale")
        else:
            depth_scale = 0.001
            assumptions.append("No depth scale is given: one unit is taken as 1 mm.")
    images = sorted_images(_image_folder(folder, content))
    metadata = RecordingMetadata("yaml", folder, images, intrinsics, depth_scale, assumptions=assumptions)
    if "mount" in content:
        metadata.mounts = np.tile(_mount(content["mount"]), (len(images), 1))
    metadata.poses = _rows(metadata, content, "poses", 3, "x y yaw of each frame")
    metadata.goals = _rows(metadata, content, "goals", 2, "x y of each frame's goal")
    return metadata


def _read_yaml(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {}
    try:
        content = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{FILE_NAME} is not valid YAML: {' '.join(str(error).split())[:200]}.") from None
    if not isinstance(content, dict):
        raise InputError(f"{FILE_NAME} must hold keys such as intrinsics and depth_scale.")
    unknown = sorted(str(key) for key in set(content) - _KEYS)
    if unknown:
        raise InputError(f"{FILE_NAME} has unknown keys {', '.join(unknown)}; known are {', '.join(sorted(_KEYS))}.")
    return content


def _intrinsics(content: dict[str, Any]) -> Intrinsics:
    if "intrinsics" not in content:
        raise InputError(
            f"The intrinsics are unknown; write them into {FILE_NAME} (intrinsics: {{width, height, fx, fy, cx, cy}}) "
            "or give them as arguments."
        )
    values = _fields(content["intrinsics"], "intrinsics", _INTRINSICS, required=_INTRINSICS)
    return Intrinsics(int(values.pop("width")), int(values.pop("height")), **values)


def _mount(entry: Any) -> Float[np.ndarray, " 5"]:
    """Camera mount array; what is not given is as in `CameraMount`, roll and left 0."""
    values = _fields(entry, "mount", _MOUNT, required=("height", "pitch_deg"))
    if not 0.05 < values["height"] < 5.0 or abs(values["pitch_deg"]) > 85.0 or abs(values.get("roll_deg", 0.0)) > 60.0:
        raise InputError(
            f"The mount {values} in {FILE_NAME} cannot be; height is in metres above the floor, angles are in degrees."
        )
    return np.array(
        [
            values["height"],
            math.radians(values["pitch_deg"]),
            math.radians(values.get("roll_deg", 0.0)),
            values.get("forward", CameraMount.forward),
            values.get("left", 0.0),
        ]
    )


def _fields(entry: Any, name: str, known: tuple[str, ...], required: tuple[str, ...]) -> dict[str, float]:
    if not isinstance(entry, dict) or set(entry) - set(known) or set(required) - set(entry):
        raise InputError(f"{FILE_NAME}: {name} needs {', '.join(required)} and knows {', '.join(known)}.")
    return {key: _number(value, f"{name}.{key}") for key, value in entry.items()}


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{FILE_NAME}: {name} must be a finite number, got {value!r}.")
    return float(value)


def _image_folder(folder: Path, content: dict[str, Any]) -> Path:
    if "depth" in content:
        return folder / str(content["depth"])
    return folder / "depth" if (folder / "depth").is_dir() else folder


def _rows(
    metadata: RecordingMetadata, content: dict[str, Any], key: str, width: int, what: str
) -> Float[np.ndarray, "n width"] | None:
    """Rows of `poses` or `goals`; NaN where the file has fewer rows than images."""
    if content.get(key) is None:
        return None
    entry = content[key]
    if isinstance(entry, str):
        rows, file = read_numbers(metadata.folder / entry, (width,), what), entry
    else:
        file = FILE_NAME
        try:
            rows = np.asarray(entry, float).reshape(-1, width).tolist()
        except (TypeError, ValueError):
            raise InputError(
                f"{FILE_NAME}: {key} must be rows of {width} numbers or the name of a text file."
            ) from None
    count = len(metadata.images)
    if len(rows) != count:
        metadata.problems.append(
            FileProblem(file, f"has {len(rows)} {key} for {count} images; they must match one to one.")
        )
    table = np.full((count, width), np.nan)
    table[: len(rows)] = rows[:count]
    return table
