"""What the robot decides from what it knows: which way to go at a camera frame, its footsteps when a step begins.

Nothing here knows the scene, the true state or the physics, so that the same functions run in simulation and on a
robot.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control import FootstepPlan, GaitMode, GaitState, Posture
from iwalker_jax.navigation.camera import RobotCamera, base_pose, camera_in_world, measured_mount
from iwalker_jax.navigation.camera_health import CameraHealth, check_camera, healthy_camera
from iwalker_jax.navigation.guide import Guidance, GuideMemory, Observation, guide, start_guide
from iwalker_jax.navigation.navigators import LoopParameters, Navigator
from iwalker_jax.navigation.sightings import Sighting
from iwalker_jax.navigation.step_planning import Stance, centre_of, has_nothing_to_do, plan_steps, stop_steps
from iwalker_jax.robot import RobotModel, rigid_body_terms


class Goals(NamedTuple):
    """Where to go, one goal after the other.

    Attributes:
        points: (g, 2) [m] world.
        count: () int32, how many of them are meant.
    """

    points: Float[Array, "g 2"]
    count: Int[Array, ""]  # type: ignore[assignment]  # hides tuple.count, which nobody needs here


class FrameMemory(NamedTuple):
    """What is remembered from camera frame to camera frame.

    Attributes:
        guide: what was seen, and the route.
        health: whether the camera is to be trusted.
        goal: () int32, index of the present goal.
        last_progress: (3,) x, y [m] and time [s] of the last progress.
        last_route: () [s] when the map last had a route.
    """

    guide: GuideMemory
    health: CameraHealth
    goal: Int[Array, ""]
    last_progress: Float[Array, "3"]
    last_route: Float[Array, ""]


class StepRequest(NamedTuple):
    """What the footsteps of a frame are for.

    Attributes:
        guidance: the path to follow.
        stop: () bool, stand still instead.
    """

    guidance: Guidance
    stop: Bool[Array, ""]


class FrameDecision(NamedTuple):
    """What is decided at a camera frame.

    Attributes:
        request: to the footsteps until the next frame.
        arrived: () bool, the robot believes to be at its last goal.
        stuck: () bool, it has not come on for long, or long had no route.
    """

    request: StepRequest
    arrived: Bool[Array, ""]
    stuck: Bool[Array, ""]


class StepClock(NamedTuple):
    """Where the gait is, as in `GaitState`.

    Attributes:
        mode: () int32, a `GaitMode`.
        stance: () int32, the `Side` of the stance foot.
        step: () int32, footsteps of the plan that were taken.
        time: () [s] in the present mode; walking, since the last touchdown.
    """

    mode: Int[Array, ""]
    stance: Int[Array, ""]
    step: Int[Array, ""]
    time: Float[Array, ""]


class StepMemory(NamedTuple):
    """What is remembered from footsteps to footsteps.

    Attributes:
        plan: the footsteps.
        stopping: () bool, whether they end in standing.
        spot: (2,) [m] where they hold a robot that does not advance.
    """

    plan: FootstepPlan
    stopping: Bool[Array, ""]
    spot: Float[Array, "2"]


def start_frames(navigator: Navigator, base: Float[Array, "3"]) -> FrameMemory:
    """Memory of a robot that knows nothing of the scene yet.

    Args:
        navigator: the robot.
        base: believed pose of the base frame in the world.
    """
    shape = (navigator.intrinsics.height, navigator.intrinsics.width)
    return FrameMemory(
        guide=start_guide(navigator.guidance, base[:2]),
        health=healthy_camera(shape, base.dtype),
        goal=jnp.zeros((), jnp.int32),
        last_progress=jnp.append(base[:2], 0.0),
        last_route=jnp.zeros((), base.dtype),
    )


def start_steps(navigator: Navigator, base: Float[Array, "3"]) -> StepMemory:
    """Memory of a robot that stands and has no footsteps; `base` as in `start_frames`."""
    count = navigator.planner.merge().istepper.geometry.count
    plan = FootstepPlan(
        jnp.zeros((count, 2), base.dtype),
        jnp.zeros(count, base.dtype),
        jnp.zeros((), jnp.int32),
        jnp.zeros((), jnp.int32),
    )
    return StepMemory(plan, jnp.asarray(False), base[:2])


def camera_base(
    robot: RobotModel, camera: RobotCamera, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]
) -> tuple[Float[Array, "3"], Float[Array, "5"], Float[Array, ""]]:
    """Pose of the base frame, camera mount in it, and speed [m/s] of a robot in a state."""
    terms = rigid_body_terms(robot, qpos, qvel)
    rotation, position = camera_in_world(camera, qpos)
    base = base_pose(rotation, terms.com)
    speed = jnp.sqrt(jnp.sum(terms.com_velocity[:2] ** 2) + 1e-12)
    return base, measured_mount(rotation, position, base), speed


def decide_frame(
    navigator: Navigator,
    goals: Goals,
    memory: FrameMemory,
    seen: Sighting,
    believed: Float[Array, "3"],
    time: Float[Array, ""],
) -> tuple[FrameMemory, FrameDecision]:
    """Check the camera, remember what it saw, choose the goal and the way to it, and whether to stop.

    Args:
        navigator: the robot.
        goals: where to go.
        memory: of the frames before.
        seen: the image that arrived, with what the robot knew of itself when it was taken.
        believed: present pose of the base frame in the world.
        time: [s] since the start.
    """
    health = check_camera(navigator.health, memory.health, seen.depth, seen.speed)
    goal, arrived = _next_goal(navigator.loop, goals, memory.goal, believed)
    observation = Observation(seen.depth, seen.mount, seen.base, goals.points[goal])
    planner = navigator.planner.merge()
    memory_ipath = None if navigator.memory_ipath is None else navigator.memory_ipath.merge()
    guided, guidance = guide(navigator.guidance, planner, navigator.intrinsics, memory.guide, observation, memory_ipath)
    last_progress, stuck = _progress(navigator.loop, memory.last_progress, believed, time)
    last_route = jnp.where(guidance.route_exists, time, memory.last_route)
    stuck = stuck | (time - last_route > navigator.loop.route_timeout)
    stop = health.failed | arrived | stuck
    if navigator.loop.latency_frames:
        stop = stop | ~seen.taken
    if navigator.pursuit is not None:
        stop = stop | has_nothing_to_do(navigator.pursuit, guidance.path, guidance.face_point, believed)
    memory = FrameMemory(guided, health, goal, last_progress, last_route)
    return memory, FrameDecision(StepRequest(guidance, stop), arrived, stuck)


def decide_steps(
    navigator: Navigator, request: StepRequest, posture: Posture, clock: StepClock, memory: StepMemory
) -> tuple[StepMemory, Bool[Array, ""]]:
    """New footsteps if a step has begun or a standing robot is to go, and whether there are any.

    Args:
        navigator: the robot.
        request: of the last camera frame.
        posture: of the robot as it believes to be.
        clock: where its gait is.
        memory: the present footsteps.
    """
    stands = clock.mode == GaitMode.STAND
    begun = step_has_begun(clock, memory.plan, memory.stopping)
    go = stands & ~request.stop
    stance = stance_of(posture, clock)
    istepper, guidance = navigator.planner.merge().istepper, request.guidance
    centre = centre_of(stance, istepper.geometry.width)
    # Beside an obstacle the spot moves off it: turning there, the body would sway and drift into it.
    cramped = jnp.any(guidance.room_offset != 0)
    spot = jnp.where(cramped, centre + guidance.room_offset, jnp.where(stands, centre, memory.spot))
    follow, spot = plan_steps(navigator.pursuit, istepper, guidance.path, guidance.face_point, stance, spot)
    stop = stop_steps(istepper.geometry.count, istepper.geometry.width, stance)
    ends = begun & request.stop
    new = begun | go
    # A robot that stands and is to stop forgets footsteps that it has not begun.
    count = jnp.where(stands & request.stop, 0, memory.plan.count)
    present = memory.plan._replace(count=count)
    chosen = jax.tree.map(lambda a, b: jnp.where(ends, a, b), stop, follow)
    plan = jax.tree.map(lambda a, b: jnp.where(new, a, b), chosen, present)
    return StepMemory(
        plan=plan,
        stopping=jnp.where(new, ends, memory.stopping & ~stands),
        spot=jnp.where(new, spot, memory.spot),
    ), new


def step_has_begun(clock: StepClock, plan: FootstepPlan, stopping: Bool[Array, ""]) -> Bool[Array, ""]:
    """Whether a walking robot has made a step of its plan, so that it is time for another one.

    A new plan begins with the step under way; a robot without one may be stepping to catch itself.
    """
    return (clock.mode == GaitMode.WALK) & ((clock.step > 0) | (plan.count == 0)) & ~stopping


def clock_of(gait: GaitState) -> StepClock:
    """What the footsteps need to know of the step clock."""
    return StepClock(gait.mode, gait.stance, gait.step, gait.time)


def stance_of(posture: Posture, clock: StepClock) -> Stance:
    """Where the next steps start from."""
    return Stance(
        com=posture.com[:2],
        com_velocity=posture.com_velocity[:2],
        foot=posture.feet[clock.stance, :2],
        yaw=posture.foot_yaws[clock.stance],
        side=clock.stance,
        time=clock.time,
    )


def begin_plan(gait: GaitState, new: Bool[Array, ""]) -> GaitState:
    """The step clock at the beginning of a plan, if there is a new one: it counts its steps along the plan and moves
    plans that it cannot keep; a new plan starts at the robot."""
    return gait._replace(
        step=jnp.where(new, 0, gait.step),
        offset=jnp.where(new, 0.0, gait.offset),
    )


def _next_goal(
    loop: LoopParameters, goals: Goals, goal: Int[Array, ""], believed: Float[Array, "3"]
) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Index of the goal to walk to, and whether the last one is reached."""
    near = jnp.sum((goals.points[goal] - believed[:2]) ** 2) < loop.arrival_distance**2
    last = goal >= goals.count - 1
    return jnp.where(near & ~last, goal + 1, goal), near & last


def _progress(
    loop: LoopParameters, last: Float[Array, "3"], believed: Float[Array, "3"], time: Float[Array, ""]
) -> tuple[Float[Array, "3"], Bool[Array, ""]]:
    """The place and time of the last progress, and whether there has been none for too long."""
    moved = jnp.sum((believed[:2] - last[:2]) ** 2) > loop.progress_distance**2
    last = jnp.where(moved, jnp.append(believed[:2], time), last)
    return last, time - last[2] > loop.progress_timeout
