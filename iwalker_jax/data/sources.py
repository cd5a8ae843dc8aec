"""Training frames from their sources: generated and cached, or a user's own recording, and the robot's episodes."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from iwalker_jax.data.frame_set import FrameSet, concatenate, load_frames, save_frames
from iwalker_jax.data.from_recording import frames_from_recording
from iwalker_jax.data.from_scenes import generate_training_frames
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import default_cache_folder
from iwalker_jax.streams import check_seed
from iwalker_jax.version import __version__

MOST_FRAMES = 1_000_000
"""Of a synthetic data set."""

GENERATOR = 1
"""Raised whenever the same seed would give other frames, so that cached ones are made anew."""


@dataclass(frozen=True)
class DataConfig:
    """What to train on.

    Attributes:
        folder: a recording of your own, or a bag; None generates synthetic scenes.
        frames: number of synthetic frames; the paper has 1185.
        seed: of layouts, camera paths and noise.
        episodes: file of frames from the robot's own episodes (`experiments.collect`), added to the others.
        topic: of the depth images in a bag that has several; None chooses.
    """

    folder: Path | None = None
    frames: int = 1185
    seed: int = 0
    episodes: Path | None = None
    topic: str | None = None

    def __post_init__(self) -> None:
        check_seed(self.seed, "the frames")
        if self.frames > MOST_FRAMES:
            raise InputError(f"{self.frames!s:.24} frames are more than any machine holds; give at most {MOST_FRAMES}.")


def load_training_frames(
    source: DataConfig,
    camera: Intrinsics,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
    say: Callable[[str], None] = print,
) -> FrameSet:
    """The frames that a configuration asks for.

    Args:
        source: recording folder, or number and seed of synthetic frames.
        camera: that scenes are rendered through and recordings are re-projected to.
        on_progress: hears (done, total) while frames are generated.
        say: hears what was assumed or repaired.

    Raises:
        InputError: if a recording is unusable, or frames of episodes were seen through another camera.
    """
    # Read first: making the others takes a while.
    episodes = None if source.episodes is None else load_frames(source.episodes)
    frames = _own_frames(source, camera, on_progress, say)
    return frames if episodes is None else concatenate([frames, episodes])


def _own_frames(
    source: DataConfig, camera: Intrinsics, on_progress: Callable[[int, int], None], say: Callable[[str], None]
) -> FrameSet:
    if source.folder is not None:
        return frames_from_recording(source.folder, seed=source.seed, say=say, camera=camera, topic=source.topic)
    file = cache_file(source, camera)
    if file.exists():
        try:
            return load_frames(file)
        except InputError as error:
            say(f"{error} Making it anew now.")
    frames = generate_training_frames(
        source.frames, source.seed, intrinsics=camera, on_progress=lambda n: on_progress(n, source.frames)
    )
    try:
        save_frames(frames, file)
    except InputError as error:
        say(f"{error} Going on without the cache.")
    return frames


def cache_file(source: DataConfig, camera: Intrinsics) -> Path:
    """Where the synthetic frames of a source are kept; the name depends on all that determines them."""
    recipe = {
        "frames": source.frames,
        "seed": source.seed,
        "camera": asdict(camera),
        "camera_paths": asdict(CameraPathSampling()),
        "generator": GENERATOR,
    }
    recipe["version"] = __version__
    digest = hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()[:16]
    return default_cache_folder() / "frames" / f"{source.frames}-{source.seed}-{digest}.npz"
