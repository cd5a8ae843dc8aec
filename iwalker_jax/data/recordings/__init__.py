"""Recorded depth sequences as data sets: three folder layouts, validated file by file before use."""

from iwalker_jax.data.recordings.recording import Recording, load_recording, validate_recording
from iwalker_jax.data.recordings.report import FileProblem, RecordingReport
from iwalker_jax.perception.depth_png import read_depth_png

__all__ = ["FileProblem", "Recording", "RecordingReport", "load_recording", "read_depth_png", "validate_recording"]
