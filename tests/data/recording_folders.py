"""Tiny recordings of a bare floor in every layout, written by NumPy and OpenCV for the loader's tests."""

from pathlib import Path

import cv2
import numpy as np
import yaml

WIDTH, HEIGHT, FOCAL = 120, 90, 60.0
INTRINSICS = {"width": WIDTH, "height": HEIGHT, "fx": FOCAL, "fy": FOCAL, "cx": 59.5, "cy": 44.5}
CAMERA_HEIGHT, PITCH, ROLL = 0.6, np.deg2rad(20.0), np.deg2rad(6.0)


def floor_image(units_per_metre: float, shift: float = 0.0) -> np.ndarray:
    """uint16 image of a floor CAMERA_HEIGHT below, and a wall 4 m ahead (`shift` [m] moves it)."""
    u, v = np.meshgrid((np.arange(WIDTH) - 59.5) / FOCAL, (np.arange(HEIGHT) - 44.5) / FOCAL)
    normal = [np.cos(PITCH) * np.sin(ROLL), np.cos(PITCH) * np.cos(ROLL), np.sin(PITCH)]
    inverse = (normal[0] * u + normal[1] * v + normal[2]) / CAMERA_HEIGHT
    depth = 1.0 / np.maximum(inverse, 1.0 / (4.0 + shift))
    return np.round(depth * units_per_metre).astype(np.uint16)


def write_images(folder: Path, names: list[str], units_per_metre: float) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for index, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), floor_image(units_per_metre, 0.01 * index))


def write_yaml_recording(folder: Path, count: int = 3, **content) -> Path:
    """`content` replaces or adds keys of recording.yaml; None removes one."""
    write_images(folder / "depth", [f"{k:06d}.png" for k in range(count)], 1000.0)
    keys = {"intrinsics": INTRINSICS, "depth_scale": 0.001} | content
    (folder / "recording.yaml").write_text(yaml.safe_dump({k: v for k, v in keys.items() if v is not None}))
    return folder


def write_tum_recording(folder: Path, rows: list[str], count: int = 3) -> Path:
    """`rows` are the lines of groundtruth.txt; image k has the stamp 100 + k / 10."""
    stamps = [f"{100 + 0.1 * k:.6f}" for k in range(count)]
    write_images(folder / "depth", [f"{stamp}.png" for stamp in stamps], 5000.0)
    (folder / "depth.txt").write_text("# depth maps\n" + "".join(f"{s} depth/{s}.png\n" for s in stamps))
    (folder / "groundtruth.txt").write_text("\n".join(["# stamp tx ty tz qx qy qz qw", *rows]))
    return folder


def write_iplanner_recording(
    folder: Path, odometry: list[list[float]], extrinsics: list[float], count: int = 3, wide_matrix: bool = False
) -> Path:
    write_images(folder / "depth", [f"{k}.png" for k in range(count)], 1000.0)
    matrix = [FOCAL, 0.0, 59.5, 0.0, 0.0, FOCAL, 44.5, 0.0, 0.0, 0.0, 1.0, 0.0] + [0.0, 0.0, 0.0, 1.0] * wide_matrix
    (folder / "depth_intrinsic.txt").write_text(str(matrix) if wide_matrix else str(tuple(matrix)))
    (folder / "camera_extrinsic.txt").write_text(str(extrinsics))
    (folder / "odom_ground_truth.txt").write_text("".join(f"{row}\n" for row in odometry))
    return folder
