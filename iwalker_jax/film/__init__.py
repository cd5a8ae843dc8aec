"""Recorded motions as video, in a window or without a screen.

A name is looked up when it is first used, because `configure_rendering` has to run before anything imports mujoco.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iwalker_jax.film.headless import configure_rendering, has_screen, missing_backend
    from iwalker_jax.film.markers import add_footsteps, add_forces, add_goal, add_path, add_shadow
    from iwalker_jax.film.recorded_motion import check_motion, resample_motion, smooth_track
    from iwalker_jax.film.rendering import Overlays, VideoSettings, open_renderer, render_frames, set_configuration
    from iwalker_jax.film.video import play_motion, write_frames, write_video

__all__ = [
    "Overlays",
    "VideoSettings",
    "add_footsteps",
    "add_forces",
    "add_goal",
    "add_path",
    "add_shadow",
    "check_motion",
    "configure_rendering",
    "has_screen",
    "missing_backend",
    "open_renderer",
    "play_motion",
    "render_frames",
    "resample_motion",
    "set_configuration",
    "smooth_track",
    "write_frames",
    "write_video",
]

_MODULES = {
    "configure_rendering": "headless",
    "has_screen": "headless",
    "missing_backend": "headless",
    "add_footsteps": "markers",
    "add_forces": "markers",
    "add_goal": "markers",
    "add_path": "markers",
    "add_shadow": "markers",
    "check_motion": "recorded_motion",
    "resample_motion": "recorded_motion",
    "smooth_track": "recorded_motion",
    "Overlays": "rendering",
    "VideoSettings": "rendering",
    "open_renderer": "rendering",
    "render_frames": "rendering",
    "set_configuration": "rendering",
    "play_motion": "video",
    "write_frames": "video",
    "write_video": "video",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
