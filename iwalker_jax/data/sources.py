"""Training frames from their source: generated once and cached, or read from a user's own recording."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from iwalker_jax import __version__
from iwalker_jax.data.camera_path import CameraPathSampling
from iwalker_jax.data.frames import FrameSet, load_frames, save_frames
from iwalker_jax.data.generated import generate_training_frames
from iwalker_jax.data.recorded import frames_from_recording
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.settings import default_cache_folder

GENERATOR = 1
"""Raised whenever the same seed would give other frames, so that cached ones are made anew."""


@dataclass(frozen=True)
class DataConfig:
    """What to train on.

    Attributes:
        folder: a recording of your own; None generates synthetic scenes.
        frames: number of synthetic frames; the paper has 1185.
        seed: of layouts, walks and noise.
        walks: file of frames from the robot's own walks (`experiments.collect`), added to the others.
    """

    folder: Path | None = None
    frames: int = 1185
    seed: int = 0
    walks: Path | None = None


def load_training_frames(
    source: DataConfig,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    say: Callable[[str], None] = print,
) -> FrameSet:
    """The frames that a configuration asks for.

    Args:
        source: recording folder, or number and seed of synthetic frames.
        on_progress: hears (done, total) while frames are generated.
        say: hears what was assumed or repaired.

    Raises:
        InputError: if a recording is unusable.
    """
    frames = _own_frames(source, on_progress, say)
    return frames if source.walks is None else joined(frames, load_frames(source.walks))


def joined(first: FrameSet, second: FrameSet) -> FrameSet:
    """Both frame sets as one.

    Raises:
        InputError: if their images or their numbers of goals differ.
    """
    sizes = [(frames.depth.shape[1:], frames.goals.shape[1]) for frames in (first, second)]
    if sizes[0] != sizes[1]:
        raise InputError(
            f"Frames of {sizes[0][0]} px with {sizes[0][1]} goals and frames of {sizes[1][0]} px with {sizes[1][1]} "
            "goals cannot be trained on together; collect the walks again with the same camera and number of goals."
        )
    return FrameSet(
        depth=np.concatenate([first.depth, second.depth]),
        mounts=np.concatenate([first.mounts, second.mounts]),
        goals=np.concatenate([first.goals, second.goals]),
        poses=np.concatenate([first.poses, second.poses]),
        scene_index=np.concatenate([first.scene_index, second.scene_index + len(first.scene_names)]),
        scene_names=first.scene_names + second.scene_names,
    )


def _own_frames(source: DataConfig, on_progress: Callable[[int, int], None], say: Callable[[str], None]) -> FrameSet:
    if source.folder is not None:
        return frames_from_recording(source.folder, seed=source.seed, say=say)
    file = cache_file(source)
    if file.exists():
        try:
            return load_frames(file)
        except InputError as error:
            say(f"{error} Making it anew now.")
    frames = generate_training_frames(source.frames, source.seed, on_progress=lambda n: on_progress(n, source.frames))
    try:
        save_frames(frames, file)
    except InputError as error:
        say(f"{error} Going on without the cache.")
    return frames


def cache_file(source: DataConfig) -> Path:
    """Where the synthetic frames of a source are kept; the name depends on all that determines them."""
    recipe = {
        "frames": source.frames,
        "seed": source.seed,
        "walks": asdict(CameraPathSampling()),
        "generator": GENERATOR,
    }
    recipe["version"] = __version__
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]
    return default_cache_folder() / "frames" / f"{source.frames}-{source.seed}-{digest}.npz"
