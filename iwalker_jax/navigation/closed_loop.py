"""Camera, planner, walking and physics as one pure function: an episode in which the robot walks to its goals.

Three clocks: every control tick the whole body is controlled and the physics steps (500 Hz); several times a camera
frame it is seen whether a step has begun, and then the footsteps are planned anew (about 4 Hz); every frame (about
15 Hz) depth is rendered from where the camera really is and the path is planned anew from where the robot believes
to be.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control import FootstepPlan, GaitMode, posture_of
from iwalker_jax.errors import InputError
from iwalker_jax.estimation import estimated_qpos_qvel
from iwalker_jax.navigation.body_volume import BodyVolume, body_clearance_at
from iwalker_jax.navigation.camera import RobotCamera, base_pose, camera_in_world, measured_mount
from iwalker_jax.navigation.camera_health import CameraHealth, HealthParameters, check_camera, healthy_camera
from iwalker_jax.navigation.depth_camera import DepthCameraState, start_depth_camera, take_depth
from iwalker_jax.navigation.faults import Faults, obstacles_at, within
from iwalker_jax.navigation.guide import Guidance, GuidanceParameters, Observation, guide
from iwalker_jax.navigation.map_memory import MapMemory, empty_memory, map_cells
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.navigation.sightings import Sighting, deliver, start_sightings
from iwalker_jax.navigation.step_planning import (
    PursuitParameters,
    Stance,
    centre_of,
    has_nothing_to_do,
    plan_steps,
    stop_steps,
)
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import Planner, SplitModule
from iwalker_jax.robot import rigid_body_terms
from iwalker_jax.scenes import DepthNoise, SceneArrays
from iwalker_jax.tasks import TaskArrays
from iwalker_jax.walking import Conditions, Sample, Walker, WalkState, start_walk, walk_tick

_LEAST_OFFSET = 0.005  # [m] to more room, below which the spot stays: the band's steps end short of it


@dataclass(frozen=True)
class LoopParameters:
    """Clocks and ends of an episode.

    Attributes:
        ticks_per_check: control ticks from one check whether new footsteps are due to the next.
        checks_per_frame: such checks in a camera frame.
        latency_frames: camera frames from taking an image to planning on it, and on the pose at which it was taken.
        arrival_distance: [m] from which a goal counts as reached.
        progress_distance: [m] of displacement that counts as progress.
        progress_timeout: [s] without progress after which the robot gives up.
        route_timeout: [s] without any route on the map after which it does.
    """

    ticks_per_check: int = 11
    checks_per_frame: int = 3
    latency_frames: int = 0
    arrival_distance: float = 0.30
    progress_distance: float = 0.30
    progress_timeout: float = 15.0
    route_timeout: float = 4.0

    def __post_init__(self) -> None:
        if self.ticks_per_check < 1 or self.checks_per_frame < 1:
            raise InputError("LoopParameters needs at least one tick per check and one check per frame.")
        if self.latency_frames < 0:
            raise InputError("LoopParameters needs a latency of 0 or more camera frames.")
        if not min(self.arrival_distance, self.progress_distance, self.progress_timeout, self.route_timeout) > 0:
            raise InputError("LoopParameters needs positive distances [m] and times [s].")


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Navigator:
    """A robot with everything that makes it find its way.

    Attributes:
        walker: the walking robot.
        camera: fixed to the robot.
        volume: of the robot's body, for its clearance.
        planner: the networks.
        guidance: how paths come about.
        pursuit: how footsteps do; None takes the networks' output as it is.
        noise: of the depth camera; None for ideal depth.
        intrinsics: of its images.
        loop: clocks and ends of an episode.
        health: when the camera counts as failed.
    """

    walker: Walker
    camera: RobotCamera
    volume: BodyVolume
    planner: SplitModule[Planner]
    guidance: GuidanceParameters = field(metadata={"static": True}, default=GuidanceParameters())
    pursuit: PursuitParameters | None = field(metadata={"static": True}, default=PursuitParameters())
    noise: DepthNoise | None = field(metadata={"static": True}, default=DepthNoise())
    intrinsics: Intrinsics = field(metadata={"static": True}, default=Intrinsics())
    loop: LoopParameters = field(metadata={"static": True}, default=LoopParameters())
    health: HealthParameters = field(metadata={"static": True}, default=HealthParameters())

    @property
    def frame_time(self) -> float:
        """[s] between two camera frames."""
        return self.loop.ticks_per_check * self.loop.checks_per_frame * self.walker.controller.time_step


class LoopState(NamedTuple):
    """Everything that an episode carries from frame to frame.

    Attributes:
        walk: the walking robot; frozen once the episode has ended.
        plan: its footsteps.
        stopping: whether they end in standing.
        spot: (2,) [m] where they hold a robot that does not advance.
        memory: what it remembers of the map.
        health: whether its camera is to be trusted.
        goal: index of the present goal.
        outcome: `Outcome` so far.
        last_progress: (3,) x, y [m] and time [s] of the last progress.
        last_route: () [s] when the map last had a route.
        depth_camera: errors of the depth camera that last.
        underway: images that were taken and have not arrived yet, oldest first.
    """

    walk: WalkState
    plan: FootstepPlan
    stopping: Bool[Array, ""]
    spot: Float[Array, "2"]
    memory: MapMemory
    health: CameraHealth
    goal: Int[Array, ""]
    outcome: Int[Array, ""]
    last_progress: Float[Array, "3"]
    last_route: Float[Array, ""]
    depth_camera: DepthCameraState
    underway: tuple[Sighting, ...]


class StepRequest(NamedTuple):
    """What the footsteps of a frame are for.

    Attributes:
        guidance: the path to follow.
        stop: () bool, stand still instead.
    """

    guidance: Guidance
    stop: Bool[Array, ""]


def start_episode(navigator: Navigator, task: TaskArrays, conditions: Conditions) -> LoopState:
    """The robot standing at the task's start, knowing nothing of the scene.

    Args:
        navigator: the robot.
        task: where it starts and its goals.
        conditions: what it meets; its start state is moved to the task's start (see `place_at`).
    """
    walk = start_walk(navigator.walker, conditions)
    dtype = conditions.qpos.dtype
    geometry = navigator.planner.merge().istepper.geometry
    plan = FootstepPlan(
        jnp.zeros((geometry.count, 2), dtype),
        jnp.zeros(geometry.count, dtype),
        jnp.zeros((), jnp.int32),
        jnp.zeros((), jnp.int32),
    )
    base, mount, _ = _believed_base(navigator, walk)
    shape = (navigator.intrinsics.height, navigator.intrinsics.width)
    none = jnp.zeros((), jnp.int32)
    return LoopState(
        walk=walk,
        plan=plan,
        stopping=jnp.asarray(False),
        spot=base[:2],
        memory=empty_memory(navigator.guidance.memory, base[:2]),
        health=healthy_camera(shape, dtype),
        goal=none,
        outcome=none + int(Outcome.RUNNING),
        last_progress=jnp.append(base[:2], 0.0),
        last_route=jnp.zeros((), dtype),
        depth_camera=start_depth_camera(navigator.camera, conditions.qpos, jax.random.fold_in(conditions.key, 1)),
        underway=start_sightings(navigator.loop.latency_frames, shape, mount, base),
    )


def camera_frame(
    navigator: Navigator, task: TaskArrays, conditions: Conditions, faults: Faults, state: LoopState, images: bool
) -> tuple[LoopState, EpisodeRecord]:
    """One camera frame of an episode: see, plan, and walk until the next one.

    Args:
        navigator: the robot.
        task: its goals.
        conditions: friction, masses, pushes and sensor noise that it meets.
        faults: of camera, odometry and scene.
        state: at the frame's beginning.
        images: whether to record depth and map (static).
    """
    running = state.outcome == Outcome.RUNNING
    time = state.walk.physics.time
    scene = obstacles_at(faults, task.scene, time)
    # Visual odometry looks through the same camera.
    unseen = within(faults.odometry, time) | within(faults.blind, time) | within(faults.frozen, time)
    conditions = conditions._replace(images_lost=unseen)
    believed, mount, speed = _believed_base(navigator, state.walk)
    qpos = state.walk.physics.qpos
    depth_camera, depth = take_depth(
        navigator.camera, navigator.intrinsics, navigator.noise, scene, qpos, state.depth_camera
    )
    depth = jnp.where(within(faults.blind, time), 0.0, depth)
    last = state.underway[-1].depth if state.underway else state.health.last
    depth = jnp.where(within(faults.frozen, time), last, depth)
    seen, underway = deliver(state.underway, Sighting(depth, mount, believed, speed, jnp.asarray(True)))
    health = check_camera(navigator.health, state.health, seen.depth, seen.speed)
    state = state._replace(depth_camera=depth_camera, health=health, underway=underway)

    goal, arrived = _next_goal(navigator, task, state.goal, believed)
    observation = Observation(seen.depth, seen.mount, seen.base, task.goals[goal])
    planner = navigator.planner.merge()
    memory, guidance = guide(navigator.guidance, planner, navigator.intrinsics, state.memory, observation)
    state = state._replace(goal=goal, memory=memory)

    last_progress, stuck = _progress(navigator.loop, state.last_progress, believed, time)
    last_route = jnp.where(guidance.route_exists, time, state.last_route)
    stuck = stuck | (time - last_route > navigator.loop.route_timeout)
    stop = state.health.failed | arrived | stuck
    if underway:
        stop = stop | ~seen.taken
    if navigator.pursuit is not None:
        stop = stop | has_nothing_to_do(navigator.pursuit, guidance.path, guidance.face_point, believed)
    request = StepRequest(guidance, stop)
    state = state._replace(last_progress=last_progress, last_route=last_route)
    check = partial(_check_and_walk, navigator, scene, conditions, request)
    state, (samples, clearances) = jax.lax.scan(check, state, None, length=navigator.loop.checks_per_frame)

    stands = state.walk.memory.controller.gait.mode == GaitMode.STAND
    outcome = state.outcome
    for ended, meaning in (
        (time >= task.time_limit, Outcome.TIMED_OUT),
        (stuck & stands, Outcome.GAVE_UP),
        (arrived & stands, Outcome.REACHED),
        (state.walk.fallen, Outcome.FELL),
        (jnp.min(clearances) < 0, Outcome.COLLIDED),
    ):
        outcome = jnp.where(running & ended, int(meaning), outcome)
    # An ended episode is frozen, so that it costs its neighbours nothing and can be looked at as it ended.
    ended = outcome != Outcome.RUNNING
    state = state._replace(outcome=outcome, walk=state.walk._replace(fallen=state.walk.fallen | ended))
    record = _record(navigator, state, seen, request, samples, jnp.min(clearances), images)
    return state, record


def run_episode(
    navigator: Navigator,
    task: TaskArrays,
    conditions: Conditions,
    faults: Faults,
    state: LoopState,
    frames: int,
    images: bool = False,
) -> tuple[LoopState, EpisodeRecord]:
    """Camera frames of one episode, one after the other; vmap over task, conditions, faults and state for many."""

    def step(state: LoopState, _: None) -> tuple[LoopState, EpisodeRecord]:
        return camera_frame(navigator, task, conditions, faults, state, images)

    return jax.lax.scan(step, state, None, length=frames)


def _believed_state(navigator: Navigator, walk: WalkState) -> tuple[Array, Array]:
    sensing = walk.memory.sensing
    if navigator.walker.noise is None or sensing is None:
        return walk.physics.qpos, walk.physics.qvel
    return estimated_qpos_qvel(sensing.estimate)


def _believed_base(navigator: Navigator, walk: WalkState) -> tuple[Array, Array, Array]:
    """Pose of the base frame, camera mount in it, and speed [m/s], as the robot believes."""
    qpos, qvel = _believed_state(navigator, walk)
    terms = rigid_body_terms(navigator.walker.robot, qpos, qvel)
    rotation, position = camera_in_world(navigator.camera, qpos)
    base = base_pose(rotation, terms.com)
    speed = jnp.sqrt(jnp.sum(terms.com_velocity[:2] ** 2) + 1e-12)
    return base, measured_mount(rotation, position, base), speed


def _next_goal(navigator: Navigator, task: TaskArrays, goal: Array, believed: Array) -> tuple[Array, Array]:
    """Index of the goal to walk to, and whether the last one is reached."""
    near = jnp.sum((task.goals[goal] - believed[:2]) ** 2) < navigator.loop.arrival_distance**2
    last = goal >= task.goal_count - 1
    return jnp.where(near & ~last, goal + 1, goal), near & last


def _progress(loop: LoopParameters, last: Array, believed: Array, time: Array) -> tuple[Array, Array]:
    """The place and time of the last progress, and whether there has been none for too long."""
    moved = jnp.sum((believed[:2] - last[:2]) ** 2) > loop.progress_distance**2
    last = jnp.where(moved, jnp.append(believed[:2], time), last)
    return last, time - last[2] > loop.progress_timeout


def _check_and_walk(
    navigator: Navigator, scene: SceneArrays, conditions: Conditions, request: StepRequest, state: LoopState, _: None
) -> tuple[LoopState, tuple[Sample, Array]]:
    """Plan footsteps if a step has begun, walk some ticks, and measure the clearance."""
    state = _with_footsteps(navigator, request, state)

    def tick(walk: WalkState, _: None) -> tuple[WalkState, Sample]:
        return walk_tick(navigator.walker, conditions, state.plan, walk)

    walk, samples = jax.lax.scan(tick, state.walk, None, length=navigator.loop.ticks_per_check)
    clearance = body_clearance_at(navigator.walker.robot, navigator.volume, scene, walk.physics.qpos)
    return state._replace(walk=walk), (samples, clearance)


def _with_footsteps(navigator: Navigator, request: StepRequest, state: LoopState) -> LoopState:
    """The state with new footsteps, if a step has begun or a standing robot is to go."""
    gait = state.walk.memory.controller.gait
    stands = gait.mode == GaitMode.STAND
    # A new plan begins with the step under way; a robot without one may be stepping to catch itself.
    begun = (gait.mode == GaitMode.WALK) & ((gait.step > 0) | (state.plan.count == 0)) & ~state.stopping
    go = stands & ~request.stop
    terms = rigid_body_terms(navigator.walker.robot, *_believed_state(navigator, state.walk))
    posture = posture_of(terms, state.walk.memory.touching)
    stance = Stance(
        com=posture.com[:2],
        com_velocity=posture.com_velocity[:2],
        foot=posture.feet[gait.stance, :2],
        yaw=posture.foot_yaws[gait.stance],
        side=gait.stance,
        time=gait.time,
    )
    istepper, guidance = navigator.planner.merge().istepper, request.guidance
    centre = centre_of(stance, istepper.geometry.width)
    # Beside an obstacle the spot moves off it: turning there, the body would sway and drift into it.
    cramped = jnp.sum(guidance.room_offset**2) > _LEAST_OFFSET**2
    spot = jnp.where(cramped, centre + guidance.room_offset, jnp.where(stands, centre, state.spot))
    follow, spot = plan_steps(navigator.pursuit, istepper, guidance.path, guidance.face_point, stance, spot)
    stop = stop_steps(istepper.geometry.count, istepper.geometry.width, stance)
    ends = begun & request.stop
    new = begun | go
    # A robot that stands and is to stop forgets footsteps that it has not begun.
    count = jnp.where(stands & request.stop, 0, state.plan.count)
    state = state._replace(plan=state.plan._replace(count=count))
    chosen = jax.tree.map(lambda a, b: jnp.where(ends, a, b), stop, follow)
    plan = jax.tree.map(lambda a, b: jnp.where(new, a, b), chosen, state.plan)
    # The gait counts its steps along the plan and moves plans that it cannot keep; a new plan starts at the robot.
    gait = gait._replace(
        step=jnp.where(new, 0, gait.step),
        offset=jnp.where(new, 0.0, gait.offset),
    )
    memory = state.walk.memory
    memory = memory._replace(controller=memory.controller._replace(gait=gait))
    return state._replace(
        plan=plan,
        spot=jnp.where(new, spot, state.spot),
        stopping=jnp.where(new, ends, state.stopping & ~stands),
        walk=state.walk._replace(memory=memory),
    )


def _record(
    navigator: Navigator,
    state: LoopState,
    seen: Sighting,
    request: StepRequest,
    samples: Sample,
    clearance: Array,
    images: bool,
) -> EpisodeRecord:
    physics = state.walk.physics
    R_world_camera, _ = camera_in_world(navigator.camera, physics.qpos)
    base = base_pose(R_world_camera, samples.com[-1, -1])
    cells = jnp.zeros((0, 0), jnp.int8)
    if images:
        cells = map_cells(navigator.guidance.memory, state.memory)
    share = jnp.max(samples.torques / navigator.walker.controller.actuation.limits)
    return EpisodeRecord(
        time=physics.time,
        outcome=state.outcome,
        goal=state.goal,
        qpos=physics.qpos,
        base=base,
        believed=seen.base,
        feet=samples.feet[-1, -1],
        path=request.guidance.path,
        footsteps=state.plan.positions,
        first_side=state.plan.first_swing,
        clearance=clearance,
        stopped=request.stop,
        detour=request.guidance.detour,
        torque_share=share,
        qp_failures=jnp.sum(samples.qp_failures),
        depth=seen.depth.astype(jnp.float16) if images else jnp.zeros((0, 0), jnp.float16),
        cells=cells,
    )
