"""Camera, planner, walking and physics as one pure function: an episode in which the robot walks to its goals.

Three clocks: every control tick the whole body is controlled and the physics steps (500 Hz); several times a camera
frame it is seen whether a step has begun, and then the footsteps are planned anew (about 4 Hz); every frame (about
15 Hz) depth is rendered from where the camera really is and the path is planned anew from where the robot believes
to be.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from iwalker_jax.control import GaitMode, posture_of
from iwalker_jax.estimation import estimated_qpos_qvel
from iwalker_jax.navigation.body_volume import body_clearance_at
from iwalker_jax.navigation.camera import base_pose, camera_in_world
from iwalker_jax.navigation.decisions import (
    FrameMemory,
    Goals,
    StepMemory,
    StepRequest,
    begin_plan,
    camera_base,
    clock_of,
    decide_frame,
    decide_steps,
    start_frames,
    start_steps,
)
from iwalker_jax.navigation.depth_camera import DepthCameraState, start_depth_camera, take_depth
from iwalker_jax.navigation.faults import Faults, obstacles_at, within
from iwalker_jax.navigation.memory import map_cells
from iwalker_jax.navigation.navigators import Navigator
from iwalker_jax.navigation.record import EpisodeRecord, Outcome
from iwalker_jax.navigation.sightings import Sighting, deliver, start_sightings
from iwalker_jax.robot import rigid_body_terms
from iwalker_jax.scenes import SceneArrays
from iwalker_jax.tasks import TaskArrays
from iwalker_jax.walking import Conditions, Sample, WalkState, start_walk, walk_tick


class LoopState(NamedTuple):
    """Everything that an episode carries from frame to frame.

    Attributes:
        walk: the walking robot; frozen once the episode has ended.
        steps: its footsteps.
        sight: what it remembers of the frames before.
        outcome: `Outcome` so far.
        depth_camera: errors of the depth camera that last.
        underway: images that were taken and have not arrived yet, oldest first.
    """

    walk: WalkState
    steps: StepMemory
    sight: FrameMemory
    outcome: Int[Array, ""]
    depth_camera: DepthCameraState
    underway: tuple[Sighting, ...]


def start_episode(navigator: Navigator, task: TaskArrays, conditions: Conditions) -> LoopState:
    """The robot standing at the task's start, knowing nothing of the scene.

    Args:
        navigator: the robot.
        task: where it starts and its goals.
        conditions: what it meets; its start state is moved to the task's start (see `place_at`).
    """
    walk = start_walk(navigator.walker, conditions)
    base, mount, _ = _believed_base(navigator, walk)
    shape = (navigator.intrinsics.height, navigator.intrinsics.width)
    return LoopState(
        walk=walk,
        steps=start_steps(navigator, base),
        sight=start_frames(navigator, base),
        outcome=jnp.zeros((), jnp.int32) + int(Outcome.RUNNING),
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
    last = state.underway[-1].depth if state.underway else state.sight.health.last
    depth = jnp.where(within(faults.frozen, time), last, depth)
    seen, underway = deliver(state.underway, Sighting(depth, mount, believed, speed, jnp.asarray(True)))
    goals = Goals(task.goals, task.goal_count)
    sight, (request, arrived, stuck) = decide_frame(navigator, goals, state.sight, seen, believed, time)
    state = state._replace(depth_camera=depth_camera, sight=sight, underway=underway)

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
    return camera_base(navigator.walker.robot, navigator.camera, *_believed_state(navigator, walk))


def _check_and_walk(
    navigator: Navigator, scene: SceneArrays, conditions: Conditions, request: StepRequest, state: LoopState, _: None
) -> tuple[LoopState, tuple[Sample, Array]]:
    """Plan footsteps if a step has begun, walk some ticks, and measure the clearance."""
    state = _with_footsteps(navigator, request, state)

    def tick(walk: WalkState, _: None) -> tuple[WalkState, Sample]:
        return walk_tick(navigator.walker, conditions, state.steps.plan, walk)

    walk, samples = jax.lax.scan(tick, state.walk, None, length=navigator.loop.ticks_per_check)
    clearance = body_clearance_at(navigator.walker.robot, navigator.volume, scene, walk.physics.qpos)
    return state._replace(walk=walk), (samples, clearance)


def _with_footsteps(navigator: Navigator, request: StepRequest, state: LoopState) -> LoopState:
    """The state with new footsteps, if a step has begun or a standing robot is to go."""
    memory = state.walk.memory
    gait = memory.controller.gait
    terms = rigid_body_terms(navigator.walker.robot, *_believed_state(navigator, state.walk))
    posture = posture_of(terms, memory.touching)
    steps, new = decide_steps(navigator, request, posture, clock_of(gait), state.steps)
    memory = memory._replace(controller=memory.controller._replace(gait=begin_plan(gait, new)))
    return state._replace(steps=steps, walk=state.walk._replace(memory=memory))


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
        cells = map_cells(navigator.guidance.memory, state.sight.guide.cells)
    share = jnp.max(samples.torques / navigator.walker.controller.actuation.limits)
    return EpisodeRecord(
        time=physics.time,
        outcome=state.outcome,
        goal=state.sight.goal,
        qpos=physics.qpos,
        base=base,
        believed=seen.base,
        feet=samples.feet[-1, -1],
        path=request.guidance.path,
        footsteps=state.steps.plan.positions,
        first_side=state.steps.plan.first_swing,
        clearance=clearance,
        stopped=request.stop,
        detour=request.guidance.detour,
        torque_share=share,
        qp_failures=jnp.sum(samples.qp_failures),
        depth=seen.depth.astype(jnp.float16) if images else jnp.zeros((0, 0), jnp.float16),
        cells=cells,
    )
