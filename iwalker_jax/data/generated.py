"""Synthetic recordings: many walks through generated scenes as one frame set."""

from collections.abc import Callable, Sequence

import numpy as np

from iwalker_jax.data.camera_path import CameraPathSampling, record_camera_path
from iwalker_jax.data.frames import FrameSet
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene
from iwalker_jax.scenes.depth_noise import DepthNoise
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
    """`count` frames, evenly over the families, every walk in a layout of its own.

    Args:
        count: number of frames; the paper's data set has 1185 from 12 scenes.
        seed: of layouts, walks and noise; the same seed gives the same frames.
        families: names from `FAMILIES`.
        sampling: walks and goals.
        intrinsics: camera.
        noise: sensor noise; None for ideal depth.
        on_progress: hears how many frames are done.

    Raises:
        InputError: for an unknown family or a count below the number of families.
    """
    if count < len(families):
        raise InputError(f"{count} frames cannot cover {len(families)} scene families; ask for more.")
    parts: list[FrameSet] = []
    names: list[str] = []
    done = 0
    for number, family in enumerate(families):
        quota = count // len(families) + (number < count % len(families))
        layout = 0
        while quota > 0:
            scene_seed = TRAINING_LAYOUTS.number(seed, layout)
            walk = record_camera_path(
                generate_scene(family, scene_seed), seed=mixed_seed(seed, number, layout), sampling=sampling,
                intrinsics=intrinsics, noise=noise,
            )  # fmt: skip
            layout += 1
            if walk is None:
                continue
            kept = walk.select(np.arange(min(quota, len(walk))))
            parts.append(kept)
            names.append(walk.scene_names[0])
            quota -= len(kept)
            done += len(kept)
            on_progress(done)
    return concatenate_walks(parts, names)


def concatenate_walks(parts: Sequence[FrameSet], names: Sequence[str]) -> FrameSet:
    """One frame set of several single-scene ones; `names[i]` names the scene of `parts[i]`."""
    return FrameSet(
        np.concatenate([part.depth for part in parts]),
        np.concatenate([part.mounts for part in parts]),
        np.concatenate([part.goals for part in parts]),
        np.concatenate([part.poses for part in parts]),
        np.concatenate([np.full(len(part), i, np.int32) for i, part in enumerate(parts)]),
        tuple(names),
    )
