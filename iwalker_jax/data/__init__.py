"""Training frames from generated scenes, recordings and the robot's own episodes."""

from iwalker_jax.data.camera_path import record_camera_path
from iwalker_jax.data.frame_set import FrameSet, concatenate, depth_to_millimetres, load_frames, save_frames
from iwalker_jax.data.from_episodes import frames_from_episodes
from iwalker_jax.data.from_recording import frames_from_recording
from iwalker_jax.data.from_scenes import generate_training_frames
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.data.recordings import Recording, RecordingReport, load_recording, validate_recording
from iwalker_jax.data.sources import DataConfig, load_training_frames

__all__ = [
    "CameraPathSampling",
    "DataConfig",
    "FrameSet",
    "Recording",
    "RecordingReport",
    "concatenate",
    "depth_to_millimetres",
    "frames_from_episodes",
    "frames_from_recording",
    "generate_training_frames",
    "load_frames",
    "load_recording",
    "load_training_frames",
    "record_camera_path",
    "save_frames",
    "validate_recording",
]
