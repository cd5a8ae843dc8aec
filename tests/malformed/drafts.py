"""Good recordings in every layout, to be broken one thing at a time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from tests.data.recording_folders import CAMERA_HEIGHT, FOCAL, INTRINSICS, PITCH, ROLL, floor_image

FRAMES = 5
POSES = [[0.4 * k, 0.1 * k, 0.25] for k in range(FRAMES)]
MOUNT = {"height": CAMERA_HEIGHT, "pitch_deg": float(np.degrees(PITCH)), "roll_deg": float(np.degrees(ROLL))}
BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def png(image: np.ndarray) -> bytes:
    """An image as OpenCV encodes it."""
    return cv2.imencode(".png", np.ascontiguousarray(image))[1].tobytes()


FLOORS = [floor_image(1000.0, 0.01 * k) for k in range(FRAMES)]
GOOD_IMAGES = [png(image) for image in FLOORS]


@dataclass
class Draft:
    """A recording to be written: text and image files by name, special files by what makes them.

    Attributes:
        content: of recording.yaml; None writes none.
        files: bytes by name, besides.
        special: makes a file that is none, by name.
        expected: what must come of it, as `tests.malformed.recordings` knows them.
        left: images that must be left out.
        given: whether intrinsics are given by the caller.
        poses: x [m] of each usable frame, if they must be known.
    """

    content: dict[str, Any] | None = None
    files: dict[str, bytes] = field(default_factory=dict)
    special: dict[str, Callable[[Path], Any]] = field(default_factory=dict)
    expected: str = "refused"
    left: tuple[str, ...] = ()
    given: bool = False
    poses: list[float] | None = None

    def write(self, folder: Path) -> Path:
        folder.mkdir()
        if self.content is not None:
            (folder / "recording.yaml").write_text(yaml.safe_dump(self.content))
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        for name, make in self.special.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).unlink(missing_ok=True)
            make(folder / name)
        return folder

    def yaml(self, text: str | bytes) -> None:
        """recording.yaml of this very text."""
        self.content = None
        self.files["recording.yaml"] = text if isinstance(text, bytes) else text.encode()


def image_name(k: int) -> str:
    return f"depth/{k:06d}.png"


def yaml_draft(rng: np.random.Generator, mount: bool | None = None, poses: bool | None = None) -> Draft:
    """A good recording in the yaml layout, with or without mount and poses."""
    content: dict[str, Any] = {"intrinsics": dict(INTRINSICS), "depth_scale": 0.001}
    if rng.random() < 0.5 if mount is None else mount:
        content["mount"] = dict(MOUNT)
    if rng.random() < 0.5 if poses is None else poses:
        content["poses"] = [list(row) for row in POSES]
    return Draft(content, {image_name(k): GOOD_IMAGES[k] for k in range(FRAMES)})


def optical_quaternion() -> list[float]:
    level = Rotation.from_euler("y", PITCH).as_matrix() @ BODY_FROM_OPTICAL
    return Rotation.from_matrix(level @ Rotation.from_euler("z", ROLL).as_matrix()).as_quat().tolist()


def tum_draft() -> Draft:
    stamps = [100 + 0.1 * k for k in range(FRAMES)]
    q = " ".join(f"{x:.6f}" for x in optical_quaternion())
    files = {f"depth/{s:.6f}.png": png(floor_image(5000.0, 0.01 * k)) for k, s in enumerate(stamps)}
    files["depth.txt"] = "".join(f"{s:.6f} depth/{s:.6f}.png\n" for s in stamps).encode()
    files["groundtruth.txt"] = "".join(f"{s:.4f} {0.3 * k} 0 0.6 {q}\n" for k, s in enumerate(stamps)).encode()
    return Draft(None, files, given=True)


def iplanner_draft() -> Draft:
    files = {f"depth/{k}.png": GOOD_IMAGES[k] for k in range(FRAMES)}
    files["depth_intrinsic.txt"] = str([FOCAL, 0.0, 59.5, 0.0, 0.0, FOCAL, 44.5, 0.0, 0.0, 0.0, 1.0, 0.0]).encode()
    files["camera_extrinsic.txt"] = str([0.1, 0.0, 0.2, *optical_quaternion()]).encode()
    files["odom_ground_truth.txt"] = "".join(f"[{0.3 * k}, 0, 0.4, 0, 0, 0, 1]\n" for k in range(FRAMES)).encode()
    return Draft(None, files)
