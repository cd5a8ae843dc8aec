"""Films of closed-loop episodes: the robot in its scene beside the depth image it sees and the map it plans on."""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import jax
import mujoco
import numpy as np
from jaxtyping import Float, Int, UInt8

from bruce_model import load_mujoco
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.film_panels import (
    PAPER,
    PanelPlan,
    depth_panel,
    draw_text,
    legend_strip,
    map_panel,
)
from iwalker_jax.evaluation.episodes.pictures import in_true_world
from iwalker_jax.film import (
    ENDING_SECONDS,
    VideoSettings,
    add_footsteps,
    add_goal,
    add_path,
    add_shadow,
    check_motion,
    open_renderer,
    set_configuration,
    smooth_track,
    write_frames,
)
from iwalker_jax.geometry import host, side_of_step
from iwalker_jax.navigation import EpisodeRecord, Outcome
from iwalker_jax.perception import Intrinsics
from iwalker_jax.scenes import Scene
from iwalker_jax.scenes.mjcf import obstacle_geoms
from iwalker_jax.tasks import Task
from iwalker_jax.walking import TimedFootsteps

_STRIP = 36  # [px] height of the line of text, and of the legend
_WALL_COLOUR = (0.86, 0.84, 0.79, 1.0)
_FURNITURE = ((0.55, 0.62, 0.70), (0.72, 0.60, 0.47), (0.60, 0.68, 0.58), (0.66, 0.58, 0.66), (0.74, 0.70, 0.55))
_LOOK = (2.3, 22.0, -38.0)
"""Distance [m], azimuth beside the heading and elevation [deg] from which the robot is looked at."""


@dataclass(frozen=True)
class FilmSettings:
    """How an episode is filmed.

    Attributes:
        height: [px] of the robot's view, which is 4 : 3; the other two panels together are as high.
        pace: 2 shows every second frame, so that time runs twice as fast.
        cut: [m] height at which walls and furniture are cut off, so that one can look in from above.
        samples: of anti-aliasing.
        camera: that the episode's depth images were seen through.
    """

    height: int = 540
    pace: int = 2
    cut: float = 0.8
    samples: int = 4
    camera: Intrinsics = Intrinsics()

    def __post_init__(self) -> None:
        if not 120 <= self.height <= 1200 or self.height % 12:
            raise InputError(f"The film's height is {self.height} px; give a multiple of 12 from 120 to 1200.")
        if self.pace < 1 or not self.cut > 0:
            raise InputError(f"A film at {self.pace} x, cut at {self.cut} m; give a pace of 1 or more, a cut above 0.")

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) [px] of the film."""
        return self.height * 4 // 3 + self.panel[0], self.height + 2 * _STRIP

    @property
    def panel(self) -> tuple[int, int]:
        """(width, height) [px] of the depth image and of the map."""
        return self.height // 2 * 16 // 9, self.height // 2


def write_film(file: Path, task: Task, episode: EpisodeRecord, settings: FilmSettings = FilmSettings()) -> int:
    """Write one episode as a video and return its number of frames.

    Args:
        file: ends in .webm, which browsers play, .mp4 or .gif; its folder is created.
        task, episode, settings: as for `film_frames`.

    Raises:
        InputError: as for `film_frames`, or a file that cannot be written.
    """
    period = float(np.median(np.diff(np.asarray(episode.time)))) if len(episode.time) > 1 else 1.0
    return write_frames(file, film_frames(task, episode, settings), 1.0 / period)


def film_frames(
    task: Task, episode: EpisodeRecord, settings: FilmSettings = FilmSettings()
) -> Iterator[UInt8[np.ndarray, "height width 3"]]:
    """The frames of an episode's film, in RGB; the last one says how it ended and is held for `ENDING_SECONDS`.

    Args:
        task: that was given.
        episode: one, as from `row_of`, with its images kept.
        settings: size, and how many of the frames.

    Raises:
        InputError: an episode without images or motion, or nothing to draw with.
    """
    if not (np.size(episode.depth) and np.size(episode.cells)):
        raise InputError(f"The episode of {task.name} was recorded without images; keep them to film it.")
    model = film_model(task.scene, settings.cut)
    finite = np.isfinite(np.asarray(episode.qpos)).all(axis=1)
    frames = len(finite) if finite.all() else int(np.argmin(finite))
    episode = jax.tree.map(lambda part: np.asarray(part)[:frames], episode)
    qpos, time = np.asarray(episode.qpos, np.float64), np.asarray(episode.time, np.float64)
    check_motion(model, qpos, time)
    period = float(np.median(np.diff(time)))
    track = smooth_track(qpos[:, :2], period)
    heading = smooth_track(np.unwrap(episode.base[:, 2:], axis=0), period, deviation=0.8)[:, 0]
    speed = np.linalg.norm(np.gradient(track, period, axis=0), axis=1)
    # The map would rock with the torso at every step.
    seen_from = smooth_track(np.unwrap(episode.believed, axis=0), period)
    view = VideoSettings(width=settings.height * 4 // 3, height=settings.height, samples=settings.samples)
    data = mujoco.MjData(model)
    with open_renderer(model, view) as renderer:
        shown = [*range(0, frames - 1, settings.pace), frames - 1]
        for i in shown:
            # A frame was seen where the robot stood at the end of the one before.
            set_configuration(model, data, qpos[max(i - 1, 0)])
            panels = _seen(data, task, episode, i, settings), _mapped(task, episode, i, seen_from[i], settings)
            set_configuration(model, data, qpos[i])
            robot = _robot_view(renderer, data, _camera(track[i], heading[i]), task, episode, i)
            last = _composed(robot, panels, _caption(task, episode, i, speed[i], settings.pace))
            if i < frames - 1:
                yield last
    yield from itertools.repeat(_ending(last, task, episode), math.ceil(ENDING_SECONDS / period - 1e-3))


def film_model(scene: Scene, cut: float) -> mujoco.MjModel:
    """The robot in a scene without ceiling, whose geoms are cut off at a height [m], in quiet colours."""
    low = dataclasses.replace(scene, boxes=_cut(scene.boxes, 5, cut), cylinders=_cut(scene.cylinders, 4, cut))
    material = '<material name="wall" rgba="1 1 1 1" specular="0.05" shininess="0.1"/>'
    model = load_mujoco(worldbody_xml="".join(obstacle_geoms(low)), asset_xml=material)
    for kind, rows, half in (("box", low.boxes, 5), ("cylinder", low.cylinders, 4)):
        for i, row in enumerate(rows):
            geom = model.geom(f"{kind}{i}")
            wall = row[2] + row[half] > cut - 1e-6
            geom.matid = -1
            geom.rgba = _WALL_COLOUR if wall else (*_FURNITURE[i % len(_FURNITURE)], 1.0)
    return model


def _cut(rows: Float[np.ndarray, "n k"], half: int, height: float) -> Float[np.ndarray, "m k"]:
    """Boxes or cylinders below a height, the column of whose half height is given."""
    bottom, top = rows[:, 2] - rows[:, half], np.minimum(rows[:, 2] + rows[:, half], height)
    kept = np.array(rows[bottom < height - 1e-3])
    bottom, top = bottom[bottom < height - 1e-3], top[bottom < height - 1e-3]
    kept[:, 2], kept[:, half] = (bottom + top) / 2, (top - bottom) / 2
    return kept


def _camera(place_xy: Float[np.ndarray, " 2"], heading: float) -> mujoco.MjvCamera:
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.distance, beside, camera.elevation = _LOOK
    camera.azimuth = np.degrees(heading) + beside
    camera.lookat[:] = (*(place_xy + 0.35 * np.array([np.cos(heading), np.sin(heading)])), 0.2)
    return camera


def _robot_view(
    renderer: mujoco.Renderer, data: mujoco.MjData, camera: mujoco.MjvCamera, task: Task, episode: EpisodeRecord, i: int
) -> np.ndarray:
    renderer.update_scene(data, camera)
    scene = renderer.scene
    scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
    add_shadow(scene, data.xpos[1])
    for number, goal in enumerate(task.goals):
        if number >= episode.goal[i]:
            add_goal(scene, goal, current=number == episode.goal[i])
    path, steps = (in_true_world(points[i], episode, i) for points in (episode.path, episode.footsteps))
    if np.isfinite(path).all():
        add_path(scene, path)
    if np.isfinite(steps).all() and len(steps) > 2:
        add_footsteps(scene, _timed(steps, planned_sides(episode, i), float(episode.time[i])), float(episode.time[i]))
    return renderer.render()


def _timed(steps: Float[np.ndarray, "m 2"], sides: Int[np.ndarray, " m"], now: float) -> TimedFootsteps:
    """Planned footsteps that are all still to come."""
    way = np.gradient(0.5 * (steps[1:] + steps[:-1]), axis=0)
    yaws = np.arctan2(way[:, 1], way[:, 0])
    return TimedFootsteps(now + 1.0 + np.arange(len(steps)), steps, np.append(yaws, yaws[-1]), sides)


def planned_sides(episode: EpisodeRecord, i: int) -> Int[np.ndarray, " m"]:
    """The `Side` of each planned footstep of a frame."""
    return side_of_step(int(episode.first_side[i]), np.arange(episode.footsteps.shape[1]))


def _seen(
    data: mujoco.MjData, task: Task, episode: EpisodeRecord, i: int, settings: FilmSettings
) -> UInt8[np.ndarray, "height width 3"]:
    """The depth image with the plan in it."""
    x, y, yaw = np.asarray(episode.base[max(i - 1, 0)])
    R_base_world = host.rotation_about_vertical(-yaw)
    camera = data.camera("depth")
    # MuJoCo's cameras look along -z with y up.
    R_base_camera = R_base_world @ camera.xmat.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    p_base_camera = R_base_world @ (camera.xpos - np.array([x, y, 0.0]))
    plan = _plan_from(np.asarray(episode.believed[i]), task, episode, i)
    depth = np.asarray(episode.depth[i])
    return depth_panel(depth, plan, R_base_camera, p_base_camera, settings.panel, settings.camera)


def _mapped(
    task: Task, episode: EpisodeRecord, i: int, pose: Float[np.ndarray, " 3"], settings: FilmSettings
) -> UInt8[np.ndarray, "height width 3"]:
    """The map with the plan in it, from a pose near the believed one."""
    plan = _plan_from(pose, task, episode, i)
    middle = np.asarray(episode.believed[i])[:2]
    return map_panel(np.asarray(episode.cells[i]), middle, pose, plan, settings.panel)


def _plan_from(pose: Float[np.ndarray, " 3"], task: Task, episode: EpisodeRecord, i: int) -> PanelPlan:
    goal = task.goals[min(int(episode.goal[i]), len(task.goals) - 1)]
    plan = (episode.path[i], episode.footsteps[i], goal[None])
    path, steps, goal = (np.nan_to_num(host.to_base(pose, np.asarray(p))) for p in plan)
    return PanelPlan(path, steps, goal[0], planned_sides(episode, i))


def _composed(robot: np.ndarray, panels: tuple[np.ndarray, np.ndarray], caption: tuple[str, str]) -> np.ndarray:
    picture = np.concatenate([robot, np.concatenate(panels)], axis=1)
    height, left = picture.shape[0], robot.shape[1]
    picture[:, left - 1 : left + 1] = 255
    picture[height // 2 - 1 : height // 2 + 1, left:] = 255
    strip = np.full((_STRIP, picture.shape[1], 3), PAPER, np.uint8)
    draw_text(strip, caption[0], (12, 24), scale=0.55)
    draw_text(strip, caption[1], (left + 9, 24), scale=0.55)
    return np.concatenate([strip, picture, legend_strip(picture.shape[1], _STRIP)])


def _ending(picture: np.ndarray, task: Task, episode: EpisodeRecord) -> UInt8[np.ndarray, "height width 3"]:
    """The last frame with how the episode ended in place of the caption, in the outcome's colour."""
    outcome = Outcome(int(episode.outcome[-1]))
    strip = np.full((_STRIP, picture.shape[1], 3), outcome.rgb, np.uint8)
    words = f"{outcome.word.upper()}    {task.name}    {float(episode.time[-1]):.1f} s    {outcome.sentence}"
    bright = np.dot(outcome.rgb, (0.299, 0.587, 0.114)) > 150
    draw_text(strip, words, (12, 24), (20, 20, 24) if bright else (255, 255, 255), scale=0.55)
    return np.concatenate([strip, picture[_STRIP:]])


def _caption(task: Task, episode: EpisodeRecord, i: int, speed: float, pace: int) -> tuple[str, str]:
    outcome, goal = Outcome(int(episode.outcome[i])), min(int(episode.goal[i]) + 1, len(task.goals))
    state = f"walking to goal {goal} of {len(task.goals)}" if len(task.goals) > 1 else "walking to its goal"
    if outcome is not Outcome.RUNNING:
        state = outcome.sentence
    elif episode.stopped[i]:
        state = "stopping"
    elif episode.detour[i]:
        state += ", by the classical route"
    played = f"    (x {pace})" if pace > 1 else ""
    return f"{task.name}    {float(episode.time[i]):5.1f} s    {speed:.2f} m/s{played}", state
