"""Training frames from generated scenes: many camera paths as one frame set."""

from collections.abc import Callable, Sequence

import numpy as np

from iwalker_jax.data.camera_path import record_camera_path
from iwalker_jax.data.frame_set import FrameSet, concatenate
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes import FAMILIES, DepthNoise, generate_scene
from iwalker_jax.streams import TRAINING_LAYOUTS, mixed_seed


def generate_training_frames(
    count: int = 1185,
    seed: int = 0,
    families: Sequence[str] = FAMILIES,
    sampling: CameraPathSampling = CameraPathSampling(),
    intrinsics: Intrinsics = Intrinsics(),
    noise: DepthNoise | None = DepthNoise(),
    on_progress: Callable[[int], None] = lambda done: None,
) -> FrameSet:
    """`count` frames, evenly over the families, every camera path in a layout of its own.

    Args:
        count: number of frames; the paper's data set has 1185 from 12 scenes.
        seed: of layouts, camera paths and noise; the same seed gives the same frames.
        families: names from `FAMILIES`.
        sampling: camera paths and goals.
        intrinsics: camera.
        noise: sensor noise; None for ideal depth.
        on_progress: hears how many frames are done.

    Raises:
        InputError: for an unknown family or a count below the number of families.
    """
    if count < len(families):
        raise InputError(f"{count} frames cannot cover {len(families)} scene families; ask for more.")
    parts: list[FrameSet] = []
    done = 0
    for number, family in enumerate(families):
        quota = count // len(families) + (number < count % len(families))
        layout = 0
        while quota > 0:
            scene = generate_scene(family, TRAINING_LAYOUTS.number(seed, layout))
            path = record_camera_path(scene, mixed_seed(seed, number, layout), sampling, intrinsics, noise)
            layout += 1
            if path is None:
                continue
            kept = path.select(np.arange(min(quota, len(path))))
            parts.append(kept)
            quota -= len(kept)
            done += len(kept)
            on_progress(done)
    return concatenate(parts)
