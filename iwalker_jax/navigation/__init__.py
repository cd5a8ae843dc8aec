"""Episodes of a robot that finds its way by sight: camera, map memory, guidance, footsteps, and how they end."""

from iwalker_jax.navigation.body_volume import BodyVolume, body_clearance, body_clearance_at, load_body_volume
from iwalker_jax.navigation.camera import RobotCamera, base_pose, camera_in_world, load_camera, measured_mount
from iwalker_jax.navigation.camera_health import HealthParameters
from iwalker_jax.navigation.closed_loop import LoopState, run_episode, start_episode
from iwalker_jax.navigation.episodes import EpisodeProgram, RunProgress, TaskBatch, place_at
from iwalker_jax.navigation.faults import Faults, make_faults
from iwalker_jax.navigation.guide import Guidance, GuidanceParameters, GuideMemory, Observation, guide, start_guide
from iwalker_jax.navigation.memory import MapMemory, MapMemoryParameters, recorded_window
from iwalker_jax.navigation.navigators import POLICIES, LoopParameters, NavigationPolicy, Navigator, make_navigator
from iwalker_jax.navigation.path_band import BandParameters, safe_path
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.navigation.step_planning import PursuitParameters

__all__ = [
    "POLICIES",
    "BandParameters",
    "BodyVolume",
    "EpisodeProgram",
    "EpisodeRecord",
    "Faults",
    "Guidance",
    "GuidanceParameters",
    "GuideMemory",
    "HealthParameters",
    "LoopParameters",
    "LoopState",
    "MapMemory",
    "MapMemoryParameters",
    "NavigationPolicy",
    "Navigator",
    "Observation",
    "Outcome",
    "PursuitParameters",
    "RobotCamera",
    "RunProgress",
    "TaskBatch",
    "base_pose",
    "body_clearance",
    "body_clearance_at",
    "camera_in_world",
    "guide",
    "load_body_volume",
    "load_camera",
    "make_faults",
    "make_navigator",
    "measured_mount",
    "place_at",
    "recorded_window",
    "run_episode",
    "safe_path",
    "start_episode",
    "start_guide",
]
