"""Recorded depth sequences as data sets: three folder layouts and bags, validated file by file before use."""

from iwalker_jax.data.recordings.folder_files import depth_images
from iwalker_jax.data.recordings.free_ground import goal_places
from iwalker_jax.data.recordings.recording import NO_FREE_GROUND, Recording, load_recording, validate_recording
from iwalker_jax.data.recordings.report import FileProblem, RecordingReport
from iwalker_jax.perception.depth_png import read_depth_png

__all__ = [
    "NO_FREE_GROUND",
    "FileProblem",
    "Recording",
    "RecordingReport",
    "depth_images",
    "goal_places",
    "load_recording",
    "read_depth_png",
    "validate_recording",
]
