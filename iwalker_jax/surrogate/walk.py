"""A walk by sight without whole-body physics: one step of the gait at a time, as it comes out on the simulated robot.

Depth is rendered and disturbed, the map written and the path asked for as in the closed loop; the footsteps' bounded
turns are those of `pursue`. What the whole body adds to a step (its foot beside the mark, its sway, the odometry's
drift) is drawn: `SurrogateParameters` holds what recorded episodes show.
"""

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, Key

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, to_base, to_world
from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    MapMemory,
    MapMemoryParameters,
    ViewPoint,
    WideMemory,
    WideMemoryParameters,
    add_scan,
    empty_memory,
    empty_wide_memory,
    update_wide_memory,
    view_map,
)
from iwalker_jax.navigation.step_planning import PursuitParameters, pursue
from iwalker_jax.perception import CameraMount, Intrinsics, ScanParameters, clean_depth, range_scan
from iwalker_jax.planning import MapView, MemoryIPath, StepGeometry, choose_path, start_direction, waypoints_to_path
from iwalker_jax.scenes import DepthNoise, add_depth_noise, render_depth, world_camera_pose
from iwalker_jax.surrogate.true_fields import FieldParameters, TrueFields, sample_fields

_TRIES = 48  # places of which one is chosen to start from


@dataclass(frozen=True)
class SurrogateParameters:
    """The robot of the surrogate walk; standard deviations unless said otherwise.

    Attributes:
        camera: of the depth images; noise: None for ideal depth.
        mount: nominal.
        memory: of the map; wide: of the wider one; scan: how images are read into it.
        pursuit: of the path; steps: advance of one.
        sway_height: [m], sway_pitch, sway_roll, sway_yaw: [rad] and sway_left: [m] of the camera about its nominal
            pose, known to the robot but for mount_error: [rad] of pitch and roll.
        advance_share: of a step's advance that it misses; step_forward, step_left: [m] beside its mark.
        turn_share: of a step's turn that it misses; step_turn: [rad].
        drift_share: of a step's advance, drift_turn: [rad] by which odometry is wrong.
        view_steps: after which surfaces give other errors of depth.
        arrival: [m] from the goal; body_radius: [m] within which an obstacle is touched.
        start_clearance: [m]; nearest_start, farthest_start: [m] of way to the goal.
        pace: [m] of way a step, below which the walk is too slow; spare_steps: beside.
    """

    camera: Intrinsics = Intrinsics(64, 36, 32.0, 32.0, 31.5, 17.5)
    noise: DepthNoise | None = DepthNoise()
    mount: CameraMount = CameraMount()
    memory: MapMemoryParameters = SCAN_MEMORY
    wide: WideMemoryParameters = WideMemoryParameters()
    scan: ScanParameters = ScanParameters()
    pursuit: PursuitParameters = PursuitParameters()
    steps: StepGeometry = StepGeometry(count=1)
    sway_height: float = 0.004
    sway_pitch: float = 0.02
    sway_roll: float = 0.02
    sway_yaw: float = 0.04
    sway_left: float = 0.012
    mount_error: float = 0.008
    advance_share: float = 0.06
    step_forward: float = 0.006
    step_left: float = 0.008
    turn_share: float = 0.08
    step_turn: float = 0.015
    drift_share: float = 0.02
    drift_turn: float = 0.003
    view_steps: int = 4
    arrival: float = 0.3
    body_radius: float = BODY.radius
    start_clearance: float = 0.25
    nearest_start: float = 1.0
    farthest_start: float = 12.0
    pace: float = 0.04
    spare_steps: int = 60

    def __post_init__(self) -> None:
        numbers = [getattr(self, field.name) for field in fields(self) if field.type in ("float", float)]
        if not all(math.isfinite(number) and number >= 0 for number in numbers):
            raise InputError("SurrogateParameters needs finite numbers that are not negative.")
        if not (self.pace > 0 and self.arrival > 0 and 0 < self.nearest_start < self.farthest_start):
            raise InputError(
                "SurrogateParameters needs pace and arrival > 0 and 0 < nearest_start < farthest_start [m]."
            )
        if self.view_steps < 1 or self.spare_steps < 0 or self.steps.count != 1:
            raise InputError("SurrogateParameters needs view_steps >= 1, spare_steps >= 0 and steps of count 1.")


class SurrogateOutcome(IntEnum):
    """How a walk goes."""

    RUNNING = 0
    REACHED = 1
    COLLIDED = 2
    TIMED_OUT = 3


class SurrogateState(NamedTuple):
    """One robot.

    Attributes:
        key: of what is drawn next; surfaces: of the errors of depth that last.
        scene, goal: () int32, where it walks and to which of the scene's goals.
        true, believed: (3,) x, y [m], yaw [rad] of its base frame.
        memory: the map; wide: the wider one.
        direction: (2,) in which its last path began, world; zero before the first.
        step: () int32, and most_steps: () int32, after which it is too late.
    """

    key: Key[Array, ""]
    surfaces: Key[Array, ""]
    scene: Int[Array, ""]
    goal: Int[Array, ""]
    true: Float[Array, "3"]
    believed: Float[Array, "3"]
    memory: MapMemory
    wide: WideMemory
    direction: Float[Array, "2"]
    step: Int[Array, ""]
    most_steps: Int[Array, ""]


class Visit(NamedTuple):
    """What a network saw at a step, and where that is in the true scene; what training keeps.

    Attributes:
        view: of the remembered map.
        origin: (2,) [m] true place; axis: () [rad] bearing of the view's x axis in the true scene.
        scene, goal: as in `SurrogateState`.
    """

    view: MapView
    origin: Float[Array, "*batch 2"]
    axis: Float[Array, "*batch"]
    scene: Int[Array, "*batch"]
    goal: Int[Array, "*batch"]


def start_surrogate(
    parameters: SurrogateParameters, grids: FieldParameters, fields: TrueFields, key: Key[Array, ""]
) -> SurrogateState:
    """A robot somewhere in some scene, on its way to some goal of it; where none was found, it ends at once."""
    key, in_scene, to_goal, at, pick, facing, surfaces = jax.random.split(key, 7)
    scenes, goals = fields.goals.shape[:2]
    scene, goal = jax.random.randint(in_scene, (), 0, scenes), jax.random.randint(to_goal, (), 0, goals)
    corner, end = fields.scenes.bounds[scene, :2], fields.scenes.bounds[scene, 2:]
    places = jax.random.uniform(at, (_TRIES, 2)) * (end - corner)
    clearance = sample_fields(fields.clearance, scene, places, grids.resolution)
    way = way_to_go(grids, fields, scene, goal, places)
    fits = (clearance > parameters.start_clearance) & (way > parameters.nearest_start)
    fits &= way < parameters.farthest_start
    chosen = jnp.argmax(fits * jax.random.uniform(pick, (_TRIES,)))
    yaw = jax.random.uniform(facing, minval=-math.pi, maxval=math.pi)
    pose = jnp.append(places[chosen] + corner, yaw)
    allowed = parameters.spare_steps + way[chosen] / parameters.pace
    memory = empty_memory(parameters.memory, pose[:2])
    return SurrogateState(
        key=key,
        surfaces=surfaces,
        scene=scene,
        goal=goal,
        true=pose,
        believed=pose,
        memory=memory,
        wide=empty_wide_memory(parameters.wide, parameters.memory, memory),
        direction=jnp.zeros(2),
        step=jnp.zeros((), jnp.int32),
        most_steps=jnp.where(fits.any(), allowed, 0).astype(jnp.int32),
    )


def see(parameters: SurrogateParameters, fields: TrueFields, state: SurrogateState) -> SurrogateState:
    """The state with one image taken and written into the map."""
    key, sway_key, noise_key, error_key, drawn = jax.random.split(state.key, 5)
    spread = jnp.asarray(
        [parameters.sway_height, parameters.sway_pitch, parameters.sway_roll, parameters.sway_left, parameters.sway_yaw]
    )
    height, pitch, roll, left, yaw = spread * jax.random.normal(sway_key, (5,))
    nominal = parameters.mount.as_array()
    mount = nominal + jnp.stack([height, pitch, roll, jnp.zeros_like(height), jnp.zeros_like(height)])
    errors = jnp.asarray([0.0, parameters.mount_error, parameters.mount_error, 0.0, 0.0])
    believed_mount = mount + errors * jax.random.normal(error_key, (5,))
    swayed = jnp.stack([jnp.zeros_like(left), left])
    true, believed = (jnp.append(to_world(pose, swayed), pose[2] + yaw) for pose in (state.true, state.believed))
    scene = jax.tree.map(lambda leaf: leaf[state.scene], fields.scenes)
    depth = render_depth(scene, parameters.camera, *world_camera_pose(true, mount))
    surfaces = jnp.where(state.step % parameters.view_steps == 0, drawn, state.surfaces)
    if parameters.noise is not None:
        depth = add_depth_noise(noise_key, depth, parameters.noise, parameters.camera, surfaces)
    scan = range_scan(clean_depth(depth), believed_mount, parameters.camera, parameters.scan)
    memory = add_scan(parameters.memory, state.memory, believed, scan, believed_mount[3:5])
    wide = update_wide_memory(parameters.wide, parameters.memory, state.wide, memory, state.believed[:2])
    return state._replace(key=key, surfaces=surfaces, memory=memory, wide=wide)


def decide(
    parameters: SurrogateParameters,
    network: MemoryIPath,
    fields: TrueFields,
    state: SurrogateState,
    explore: Float[Array, ""],
) -> tuple[SurrogateState, Float[Array, "points 2"], Visit]:
    """The path [m] in the world as the robot believes it, and what was seen; now and then any candidate is taken.

    Args:
        parameters: of the robot.
        network: that proposes.
        fields: of its scene.
        state: after `see`.
        explore: () probability of a candidate at random.
    """
    key, gamble, pick = jax.random.split(state.key, 3)
    goal = fields.goals[state.scene, state.goal]
    at = ViewPoint(state.believed, goal, state.direction)
    view, bearing = view_map(network.config.view, parameters.memory, state.memory, state.wide, at)
    candidates = network(view)
    chosen = choose_path(network.config, candidates, view)
    any_of = jax.random.randint(pick, (), 0, candidates.log_cost.shape[0])
    chosen = jnp.where(jax.random.uniform(gamble) < explore, any_of, chosen)
    frame = jnp.append(state.believed[:2], bearing)
    path = to_world(frame, waypoints_to_path(candidates.waypoints[chosen][None])[0])
    axis = bearing + state.true[2] - state.believed[2]
    visit = Visit(view, state.true[:2], axis, state.scene, state.goal)
    return state._replace(key=key, direction=start_direction(path)), path, visit


def follow(parameters: SurrogateParameters, state: SurrogateState, path: Float[Array, "points 2"]) -> SurrogateState:
    """The state after one footstep along a path [m, world]."""
    key, step_key, drift_key = jax.random.split(state.key, 3)
    course = pursue(parameters.pursuit, parameters.steps, path, path[-1], state.believed[:2], state.believed[2])
    moved = to_base(state.believed, course.centres[1])
    turned = course.headings[1] - course.headings[0]
    missed = jax.random.normal(step_key, (5,))
    beside = jnp.stack([parameters.step_forward * missed[1], parameters.step_left * missed[2]])
    moved = moved * (1 + parameters.advance_share * missed[0]) + beside
    turned = turned * (1 + parameters.turn_share * missed[3]) + parameters.step_turn * missed[4]
    drift = jax.random.normal(drift_key, (2,))
    felt = moved * (1 + parameters.drift_share * drift[0])
    return state._replace(
        key=key,
        true=jnp.append(to_world(state.true, moved), state.true[2] + turned),
        believed=jnp.append(
            to_world(state.believed, felt), state.believed[2] + turned + parameters.drift_turn * drift[1]
        ),
        step=state.step + 1,
    )


def surrogate_step(
    parameters: SurrogateParameters,
    grids: FieldParameters,
    network: MemoryIPath,
    fields: TrueFields,
    state: SurrogateState,
    explore: Float[Array, ""],
) -> tuple[SurrogateState, Int[Array, ""], Visit]:
    """See, decide and take one step: the state, its `SurrogateOutcome`, and what was seen."""
    state, path, visit = decide(parameters, network, fields, see(parameters, fields, state), explore)
    state = follow(parameters, state, path)
    return state, _outcome(parameters, grids, fields, state), visit


def _outcome(
    parameters: SurrogateParameters, grids: FieldParameters, fields: TrueFields, state: SurrogateState
) -> Int[Array, ""]:
    corner = fields.scenes.bounds[state.scene, :2]
    clearance = sample_fields(fields.clearance, state.scene, state.true[:2] - corner, grids.resolution)
    apart = fields.goals[state.scene, state.goal] - state.true[:2]
    outcome = jnp.zeros((), jnp.int32)
    for ended, meaning in (
        (state.step >= state.most_steps, SurrogateOutcome.TIMED_OUT),
        (jnp.sum(apart**2) < parameters.arrival**2, SurrogateOutcome.REACHED),
        (clearance < parameters.body_radius, SurrogateOutcome.COLLIDED),
    ):
        outcome = jnp.where(ended, int(meaning), outcome)
    return outcome


def way_to_go(
    grids: FieldParameters, fields: TrueFields, scene: Array, goal: Array, points: Float[Array, "*batch 2"]
) -> Float[Array, "*batch"]:
    """Cost [m] of the best way to a goal from points [m] from the scene's lower corner."""
    goals = fields.to_go.shape[1]
    flat = fields.to_go.reshape(-1, *fields.to_go.shape[2:])
    return sample_fields(flat, scene * goals + goal, points, grids.cost_resolution)
