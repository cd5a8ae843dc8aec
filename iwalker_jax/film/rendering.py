"""Frames of recorded motions, drawn offscreen by MuJoCo with footsteps, forces, pushes and a clock."""

import copy
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from iwalker_jax.errors import InputError
from iwalker_jax.film.headless import NO_RENDERING, missing_backend
from iwalker_jax.film.markers import MARK_COLOURS, add_footsteps, add_forces, add_shadow
from iwalker_jax.film.recorded_motion import check_motion, resample_motion, smooth_track
from iwalker_jax.robot import contact_point_names
from iwalker_jax.walking import TimedFootsteps


@dataclass(frozen=True)
class VideoSettings:
    """How a motion is filmed.

    Attributes:
        camera: one of the model's; cameras that track a body follow the base's smoothed path.
        width, height: [px].
        fps: frames a second.
        slow_motion: 2 plays at half speed.
        samples: of anti-aliasing; without a GPU, 0 is twice as fast as 4.
    """

    camera: str = "side"
    width: int = 640
    height: int = 480
    fps: float = 30.0
    slow_motion: float = 1.0
    samples: int = 4

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            if not 16 <= getattr(self, name) <= 4096 or getattr(self, name) % 2:
                raise InputError(f"The video's {name} is {getattr(self, name)} px; give an even number, 16 to 4096.")
        for name in ("fps", "slow_motion"):
            if not 0.0 < getattr(self, name) <= 1000.0:
                raise InputError(f"The video's {name} is {getattr(self, name)}; give a number above 0, at most 1000.")
        if self.samples not in (0, 2, 4, 8):
            raise InputError(f"The video's anti-aliasing takes {self.samples} samples; give 0, 2, 4 or 8.")


ENDING_SECONDS = 1.5
"""[s] for which a film's last frame is held, so that how it ended can be read."""


class Ending(NamedTuple):
    """How a motion ended, to be read in the film's last frame.

    Attributes:
        words: a short sentence.
        colour: (r, g, b) of 8 bits, behind the words.
    """

    words: str
    colour: tuple[int, int, int]


class Overlays(NamedTuple):
    """What is drawn besides the robot; left out where None.

    Attributes:
        footsteps: planned footsteps, on the floor.
        forces: (N, c, 3) [N] contact forces at the model's contact points, world frame.
        pushes: (N, 3) [N] force on the base, world frame.
        caption: line of text under the clock.
        legend: whether to say what the marks mean.
        ending: what the last frame says, which is then held for `ENDING_SECONDS`.
    """

    footsteps: TimedFootsteps | None = None
    forces: Float[np.ndarray, "n c 3"] | None = None
    pushes: Float[np.ndarray, "n 3"] | None = None
    caption: str = ""
    legend: bool = False
    ending: Ending | None = None


def render_frames(
    model: mujoco.MjModel,
    qpos: Float[np.ndarray, "n nq"],
    times: Float[np.ndarray, " n"],
    settings: VideoSettings = VideoSettings(),
    overlays: Overlays = Overlays(),
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """The frames of a video, one by one, in RGB.

    Args:
        model: whose first body is the floating base.
        qpos: (N, nq) recorded configurations.
        times: (N,) [s] increasing.
        settings: camera, size and speed.
        overlays: what is drawn besides the robot.

    Raises:
        InputError: a bad motion or overlay, an unknown camera, or nothing to draw with.
    """
    check_motion(model, qpos, times)
    check_overlays(model, overlays, len(times))
    camera = _camera_of(model, settings.camera)
    tracking = model.cam_mode[camera] != mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    period = 1.0 / (settings.fps * settings.slow_motion)
    # The last frame shows the last instant, whether a whole number of frames leads to it or not.
    at = np.minimum(times[0] + period * np.arange(math.ceil((times[-1] - times[0]) / period - 1e-6) + 1), times[-1])
    motion = resample_motion(model, qpos, times, at)
    rows = np.minimum(np.searchsorted(times, at), len(times) - 1)
    track = smooth_track(motion[:, :3], period)
    speed = np.linalg.norm(np.gradient(track[:, :2], at, axis=0), axis=1)
    data = mujoco.MjData(model)
    with open_renderer(model, settings) as renderer:
        scene = renderer.scene
        for i, now in enumerate(at):
            set_configuration(model, data, motion[i])
            if tracking:
                data.cam_xpos[camera] += track[i] - motion[i, :3]
            renderer.update_scene(data, camera)
            # Without a GPU, MuJoCo's shadows take two thirds of the time and reflections a sixth.
            scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
            add_shadow(scene, data.xpos[1])
            draw_overlays(scene, data, overlays, now, int(rows[i]))
            image = _write_text(renderer.render(), (f"{now:.2f} s   {speed[i]:.2f} m/s", overlays.caption))
            if overlays.legend:
                _write_legend(image, overlays)
            if i < len(at) - 1:
                yield image
    if overlays.ending is None:
        yield image
        return
    _write_ending(image, overlays.ending)
    yield from itertools.repeat(image, math.ceil(ENDING_SECONDS * settings.fps - 1e-3))


def set_configuration(model: mujoco.MjModel, data: mujoco.MjData, qpos: Float[np.ndarray, " nq"]) -> None:
    """Put the model into a configuration; the stages of mj_forward that a picture needs."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def check_overlays(model: mujoco.MjModel, overlays: Overlays, instants: int) -> None:
    """Raise InputError unless the overlays fit the motion's instants and the model has the sites they need."""
    points = 0 if overlays.forces is None else len(contact_point_names(model))
    for name, wanted in (("forces", (instants, points, 3)), ("pushes", (instants, 3))):
        given = getattr(overlays, name)
        if given is not None and np.shape(given) != wanted:
            raise InputError(f"The overlay's {name} have shape {np.shape(given)}; this motion needs {wanted}.")


def draw_overlays(scene: mujoco.MjvScene, data: mujoco.MjData, overlays: Overlays, now: float, row: int) -> None:
    """Append to the scene what stands beside the robot at time `now` [s], the motion's instant `row`."""
    if overlays.footsteps is not None:
        add_footsteps(scene, overlays.footsteps, now)
    if overlays.forces is not None:
        points = [data.site(name).xpos for name in contact_point_names(data.model)]
        add_forces(scene, np.stack(points), overlays.forces[row])
    if overlays.pushes is not None:
        add_forces(scene, data.xipos[1:2], overlays.pushes[row : row + 1], push=True)


def open_renderer(model: mujoco.MjModel, settings: VideoSettings) -> mujoco.Renderer:
    """MuJoCo's offscreen renderer of the settings' size; InputError if there is nothing to draw with."""
    reason = missing_backend()
    if reason:
        raise InputError(NO_RENDERING.format(reason=reason))
    model = copy.copy(model)
    model.vis.quality.offsamples = settings.samples
    model.vis.global_.offwidth = settings.width
    model.vis.global_.offheight = settings.height
    try:
        return mujoco.Renderer(model, settings.height, settings.width)
    except Exception as error:  # every OpenGL backend fails with exceptions of its own
        raise InputError(NO_RENDERING.format(reason=" ".join(str(error).split()).rstrip("."))) from error


def _camera_of(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name)
    if index < 0:
        names = ", ".join(model.camera(i).name for i in range(model.ncam)) or "it has none"
        raise InputError(f"The model has no camera {name!r}; choose one of its cameras ({names}).")
    return index


def _write_text(
    image: UInt8[np.ndarray, "height width 3"], lines: tuple[str, ...]
) -> UInt8[np.ndarray, "height width 3"]:
    """Write lines of text into the upper left corner."""
    scale = image.shape[0] / 480
    for i, line in enumerate(lines):
        corner = (round(12 * scale), round((26 + 22 * i) * scale))
        cv2.putText(image, line, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.55 * scale, (40, 40, 45), 1, cv2.LINE_AA)
    return image


def _write_legend(image: UInt8[np.ndarray, "height width 3"], overlays: Overlays) -> None:
    """Say in the lower left corner what the marks that this motion has mean."""
    drawn = {
        "planned right footsteps": overlays.footsteps is not None,
        "planned left footsteps": overlays.footsteps is not None,
        "contact force": overlays.forces is not None,
        "push": overlays.pushes is not None and bool(np.any(overlays.pushes)),
    }
    words = [text for text, there in drawn.items() if there]
    scale = image.shape[0] / 480
    for i, text in enumerate(reversed(words)):
        y = image.shape[0] - round((14 + 20 * i) * scale)
        corners = (round(12 * scale), y - round(10 * scale)), (round(30 * scale), y)
        colour = tuple(round(255 * part) for part in MARK_COLOURS[text.removeprefix("planned ")])
        cv2.rectangle(image, *corners, colour, -1)
        place = (round(38 * scale), y)
        cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45 * scale, (40, 40, 45), 1, cv2.LINE_AA)


def _write_ending(image: UInt8[np.ndarray, "height width 3"], ending: Ending) -> None:
    """Lay a bar with the words over the top of the picture, in the ending's colour."""
    scale = image.shape[0] / 480
    image[: round(56 * scale)] = ending.colour
    place = (round(12 * scale), round(36 * scale))
    cv2.putText(image, ending.words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.7 * scale, (255, 255, 255), 1, cv2.LINE_AA)
