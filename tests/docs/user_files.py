"""The files of their own that a page's readers are assumed to have."""

from pathlib import Path

import cv2
import jax.numpy as jnp
import numpy as np

from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.tasks.named import named_task
from tests.docs.pages import fenced_blocks

CAMERA = Intrinsics(640, 360, 320.0, 320.0, 319.5, 179.5)
"""The camera of depth.png, as the pages state it."""


def write_depth_image(file: Path) -> None:
    """The view from the start of the office demonstration, as a 16-bit PNG in millimetres."""
    task = named_task("office")
    pose = world_camera_pose(jnp.asarray(task.start), CameraMount().as_array())
    depth = np.asarray(render_depth(task.scene.arrays(), CAMERA, *pose))
    assert cv2.imwrite(str(file), np.round(1000 * depth).astype(np.uint16))


def write_recording(folder: Path, page: Path, count: int = 3) -> None:
    """A recording whose recording.yaml is the page's own, in a room with a floor and a wall."""
    (folder / "depth").mkdir(parents=True)
    (yaml_block,) = (block for block in fenced_blocks(page) if block.language == "yaml")
    (folder / "recording.yaml").write_text(yaml_block.text)
    camera = Intrinsics(640, 480, 383.8, 383.8, 321.7, 236.8)
    mount = CameraMount(height=0.62, pitch=np.deg2rad(18.9), roll=np.deg2rad(10.4))
    task = named_task("office")
    pose = world_camera_pose(jnp.asarray(task.start), mount.as_array())
    depth = np.round(1000 * np.asarray(render_depth(task.scene.arrays(), camera, *pose))).astype(np.uint16)
    for number in range(count):
        assert cv2.imwrite(str(folder / "depth" / f"{number:06d}.png"), depth)
    (folder / "poses.txt").write_text("".join(f"{0.1 * number} 0 0\n" for number in range(count)))
