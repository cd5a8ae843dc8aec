"""Recorded motions as video, in a window or without a screen.

A name is looked up when it is first used, because `configure_rendering` has to run before anything imports mujoco.
"""

from typing import TYPE_CHECKING

from iwalker_jax.lazy_names import lazy_names

if TYPE_CHECKING:
    from iwalker_jax.film.headless import configure_rendering, has_screen, missing_backend
    from iwalker_jax.film.markers import add_footsteps, add_forces, add_goal, add_path, add_shadow
    from iwalker_jax.film.recorded_motion import check_motion, resample_motion, smooth_track
    from iwalker_jax.film.rendering import (
        ENDING_SECONDS,
        Ending,
        Overlays,
        VideoSettings,
        open_renderer,
        render_frames,
        set_configuration,
    )
    from iwalker_jax.film.video import play_motion, write_frames, write_video

__all__ = [
    "ENDING_SECONDS",
    "Ending",
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

_HOMES = {
    "headless": "configure_rendering has_screen missing_backend",
    "markers": "add_footsteps add_forces add_goal add_path add_shadow",
    "recorded_motion": "check_motion resample_motion smooth_track",
    "rendering": "ENDING_SECONDS Ending Overlays VideoSettings open_renderer render_frames set_configuration",
    "video": "play_motion write_frames write_video",
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
