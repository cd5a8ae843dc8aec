"""Videos of recorded motions as MP4, WebM or GIF files, or played in MuJoCo's viewer."""

import dataclasses
import itertools
import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from iwalker_jax.errors import InputError
from iwalker_jax.film.headless import has_screen
from iwalker_jax.film.recorded_motion import check_motion, resample_motion
from iwalker_jax.film.rendering import (
    Overlays,
    VideoSettings,
    check_overlays,
    draw_overlays,
    render_frames,
    set_configuration,
)
from iwalker_jax.runtime import atomic_write

_VIEW = (1.8, 130.0, -15.0)
"""Distance [m], azimuth and elevation [deg] from which the viewer first looks at the base."""

_CODECS = {".mp4": "mp4v", ".webm": "VP80"}
"""What the OpenCV of the package index can encode; it has no H.264."""


def write_video(
    file: Path,
    model: mujoco.MjModel,
    qpos: Float[np.ndarray, "n nq"],
    times: Float[np.ndarray, " n"],
    settings: VideoSettings = VideoSettings(),
    overlays: Overlays = Overlays(),
) -> int:
    """Write a recorded motion as a video and return its number of frames.

    Args:
        file: ends in .mp4, in .webm, which browsers play, or in .gif, which is large (1 MB a second at the default
            size); its folder is created.
        model, qpos, times, overlays: as for `render_frames`.
        settings: camera, size and speed; a GIF's frames last whole hundredths of a second, so 30 a second become 25.

    Raises:
        InputError: as for `render_frames`, or a file that cannot be written; no broken file is left behind.
    """
    file = Path(file)
    if _suffix(file) == ".gif":
        settings = dataclasses.replace(settings, fps=100 / math.ceil(100 / settings.fps - 1e-6))
    frames = render_frames(model, qpos, times, settings, overlays)
    return write_frames(file, frames, settings.fps)


def write_frames(file: Path, frames: Iterator[UInt8[np.ndarray, "height width 3"]], fps: float) -> int:
    """Write RGB frames of one size as a video and return their number.

    Args:
        file: ends in .mp4, .gif or .webm, which browsers play; its folder is created.
        frames: at least one.
        fps: frames a second.

    Raises:
        InputError: a file that cannot be written. Whatever goes wrong, no broken file is left behind, and one that was
            there before is kept.
    """
    file = Path(file)
    write = _write_gif if _suffix(file) == ".gif" else _write_movie
    # The first frame shows what is wrong with motion, camera or OpenGL before a file is opened.
    frames = itertools.chain([next(frames)], frames)
    try:
        with atomic_write(file) as part:
            part.open("wb").close()
            return write(frames, part, fps)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"The video {file} cannot be written ({why}); choose another place.") from error


def _suffix(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix not in (*_CODECS, ".gif"):
        raise InputError(f"The video {file} ends in {suffix!r}; use .mp4, .webm or .gif.")
    return suffix


def play_motion(
    model: mujoco.MjModel,
    qpos: Float[np.ndarray, "n nq"],
    times: Float[np.ndarray, " n"],
    overlays: Overlays = Overlays(),
    slow_motion: float = 1.0,
) -> None:
    """Play a recorded motion over and over in MuJoCo's viewer, until its window is closed.

    Raises:
        InputError: a bad motion or overlay, or no screen.
    """
    check_motion(model, qpos, times)
    check_overlays(model, overlays, len(times))
    if not has_screen():
        raise InputError("There is no screen for MuJoCo's viewer (DISPLAY is not set); write a video instead.")
    import mujoco.viewer

    data = mujoco.MjData(model)
    with mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False) as viewer:
        viewer.cam.type, viewer.cam.trackbodyid = mujoco.mjtCamera.mjCAMERA_TRACKING, 1
        viewer.cam.distance, viewer.cam.azimuth, viewer.cam.elevation = _VIEW
        start = time.monotonic()
        while viewer.is_running():
            now = times[0] + ((time.monotonic() - start) / slow_motion) % (times[-1] - times[0])
            with viewer.lock():
                set_configuration(model, data, resample_motion(model, qpos, times, np.array([now]))[0])
                viewer.user_scn.ngeom = 0
                draw_overlays(viewer.user_scn, data, overlays, now, int(np.searchsorted(times, now)))
            viewer.sync()
            time.sleep(1 / 60)


def _write_movie(frames: Iterator[UInt8[np.ndarray, "height width 3"]], file: Path, fps: float) -> int:
    first = next(frames)
    size = (first.shape[1], first.shape[0])
    codec = cv2.VideoWriter.fourcc(*_CODECS[file.suffix.lower()])
    with _without_stderr():
        writer = cv2.VideoWriter(str(file), cv2.CAP_FFMPEG, codec, fps, size)
    if not writer.isOpened():
        raise InputError(f"This OpenCV cannot encode {file.suffix} files; use the suffix .gif.")
    count = 0
    try:
        for image in itertools.chain([first], frames):
            writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
            count += 1
    finally:
        writer.release()
    return count


@contextmanager
def _without_stderr() -> Iterator[None]:
    """Silence for OpenCV, which warns of every WebM file that it knows no tag for the codec it then writes."""
    with Path(os.devnull).open("wb") as sink:
        kept = os.dup(2)
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _write_gif(frames: Iterator[UInt8[np.ndarray, "height width 3"]], file: Path, fps: float) -> int:
    """One palette for all frames, taken from the first: quick, small and without flicker."""
    from PIL import Image

    first = Image.fromarray(next(frames)).quantize(colors=128, method=Image.Quantize.MEDIANCUT)
    count = 1

    def others() -> Iterator[Image.Image]:
        nonlocal count
        for image in frames:
            count += 1
            yield Image.fromarray(image).quantize(palette=first, dither=Image.Dither.NONE)

    duration = round(1000 / fps)
    first.save(file, save_all=True, append_images=others(), duration=duration, loop=0, optimize=False)
    return count
