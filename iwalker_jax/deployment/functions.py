"""What runs on a robot, as functions of named arrays: the controller's tick, the camera frame, the footsteps.

The closed loop of `iwalker_jax.navigation` is made of the same decisions. What it gets from simulation comes as arrays
here, and what it keeps in pytrees goes out and comes back by name.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.control import (
    ControllerState,
    FootstepPlan,
    GaitMode,
    Posture,
    control_step,
    initial_controller,
    posture_of,
)
from iwalker_jax.deployment.named_arrays import from_named, named_arrays
from iwalker_jax.navigation.decisions import (
    FrameMemory,
    Goals,
    StepClock,
    StepMemory,
    StepRequest,
    begin_plan,
    camera_base,
    clock_of,
    decide_frame,
    decide_steps,
    stance_of,
    start_frames,
    start_steps,
    step_has_begun,
)
from iwalker_jax.navigation.guide import Guidance
from iwalker_jax.navigation.navigators import Navigator
from iwalker_jax.navigation.path_band import BAND_POINTS
from iwalker_jax.navigation.sightings import Sighting
from iwalker_jax.navigation.step_planning import stop_steps
from iwalker_jax.optimization import Status
from iwalker_jax.robot import rigid_body_terms
from iwalker_jax.walking import has_fallen

Arrays = dict[str, Any]
"""Named arrays, or their shapes."""

MEMORY = "memory"
"""Prefix of the arrays that a function gives back for its next call."""


def shape_of(shape: tuple[Any, ...], dtype: Any = jnp.float32) -> Any:
    """Shape and type of an array, where a template has it in the array's place."""
    return jax.ShapeDtypeStruct(shape, dtype)


CLOCK = StepClock(shape_of((), jnp.int32), shape_of((), jnp.int32), shape_of((), jnp.int32), shape_of(()))
GUIDANCE = Guidance(shape_of((BAND_POINTS, 2)), shape_of((2,)), shape_of((), bool), shape_of((), bool), shape_of((2,)))


class ControlMemory(NamedTuple):
    """What the controller remembers from tick to tick.

    Attributes:
        controller: step clock and last QP.
        plan: footsteps under way.
        plan_number: () int32, of the last command that was heeded.
        stopping: () bool, they end in standing.
        touchdowns: () int32, since the start.
    """

    controller: ControllerState
    plan: FootstepPlan
    plan_number: Int[Array, ""]
    stopping: Bool[Array, ""]
    touchdowns: Int[Array, ""]


class PlanCommand(NamedTuple):
    """Footsteps for the controller.

    Attributes:
        plan: the footsteps.
        number: () int32, another one than before if the plan is new.
        stopping: () bool, they end in standing.
        touchdowns: () int32 that the controller counted when they were planned; in a later step they come too late.
    """

    plan: FootstepPlan
    number: Int[Array, ""]
    stopping: Bool[Array, ""]
    touchdowns: Int[Array, ""]


def start_control(navigator: Navigator, arrays: Arrays) -> Arrays:
    """Memory of a controller of a robot that stands in a state."""
    memory = _initial_memory(navigator, arrays["qpos"], arrays["qvel"])
    return {**named_arrays(clock_of(memory.controller.gait), "clock"), **named_arrays(memory, MEMORY)}


def control_tick(navigator: Navigator, arrays: Arrays) -> Arrays:
    """One tick of the whole-body controller; a robot that lies gets no torques, and its memory stays."""
    walker = navigator.walker
    qpos, qvel = arrays["qpos"], arrays["qvel"]
    before = from_named(_control_memory(navigator), arrays, MEMORY)
    command = from_named(command_template(navigator), arrays, "command")
    terms = rigid_body_terms(walker.robot, qpos, qvel)
    posture = posture_of(terms, arrays["touching"])
    memory = _with_command(navigator, posture, command, arrays["halt"], before)
    arms = qpos[walker.robot.arm_positions], qvel[walker.robot.arm_velocities]
    torques, controller, info = control_step(
        walker.controller, terms, arms, arrays["touching"], memory.plan, memory.controller
    )
    changed = (controller.gait.mode == GaitMode.WALK) & (controller.gait.stance != before.controller.gait.stance)
    memory = memory._replace(controller=controller, touchdowns=before.touchdowns + changed)
    fallen = has_fallen(walker, qpos, qvel)
    memory = jax.tree.map(lambda new, old: jnp.where(fallen, old, new), memory, before)
    return {
        "torques": jnp.where(fallen, 0.0, torques),
        "contact_forces": info.forces,
        "fallen": fallen,
        "solved": info.solution.status == Status.CONVERGED,
        **named_arrays(clock_of(memory.controller.gait), "clock"),
        **named_arrays(memory, MEMORY),
    }


def _with_command(
    navigator: Navigator, posture: Posture, command: PlanCommand, halt: Bool[Array, ""], memory: ControlMemory
) -> ControlMemory:
    """Memory with footsteps that are new and in time, or, to halt, with two closing ones."""
    gait = memory.controller.gait
    clock = clock_of(gait)
    stands = clock.mode == GaitMode.STAND
    in_time = stands | (command.touchdowns == memory.touchdowns)
    heeded = (command.number != memory.plan_number) & in_time & ~halt
    plan = _where(heeded, command.plan, memory.plan)
    stopping = jnp.where(heeded, command.stopping, memory.stopping & ~stands)
    geometry = navigator.planner.merge().istepper.geometry
    ends = step_has_begun(clock, plan, stopping) & halt
    plan = _where(ends, stop_steps(geometry.count, geometry.width, stance_of(posture, clock)), plan)
    plan = plan._replace(count=jnp.where(stands & halt, 0, plan.count))
    controller = memory.controller._replace(gait=begin_plan(gait, heeded | ends))
    number = jnp.where(heeded, command.number, memory.plan_number)
    return memory._replace(controller=controller, plan=plan, plan_number=number, stopping=stopping | ends)


def start_frame(navigator: Navigator, arrays: Arrays) -> Arrays:
    """Memory of a robot in a state that has seen nothing yet, and the spot [m] where it stands."""
    base, _, _ = camera_base(navigator.walker.robot, navigator.camera, arrays["qpos"], arrays["qvel"])
    return {"spot": start_steps(navigator, base).spot, **named_arrays(start_frames(navigator, base), MEMORY)}


def camera_frame(navigator: Navigator, arrays: Arrays) -> Arrays:
    """One camera frame: what was seen goes on the map, and the way to the goal comes out."""
    robot, camera = navigator.walker.robot, navigator.camera
    seen_from, mount, speed = camera_base(robot, camera, arrays["image.qpos"], arrays["image.qvel"])
    base, _, _ = camera_base(robot, camera, arrays["qpos"], arrays["qvel"])
    memory, (request, arrived, stuck) = decide_frame(
        navigator,
        Goals(arrays["goals"], arrays["goal_count"]),
        from_named(_frame_memory(navigator), arrays, MEMORY),
        Sighting(arrays["depth"], mount, seen_from, speed, jnp.asarray(True)),
        base,
        arrays["time"],
    )
    return {
        **named_arrays(request.guidance, "way"),
        "stop": request.stop,
        "arrived": arrived,
        "stuck": stuck,
        "base": base,
        **named_arrays(memory, MEMORY),
    }


def plan_footsteps(navigator: Navigator, arrays: Arrays) -> Arrays:
    """Whether footsteps are due, and which."""
    terms = rigid_body_terms(navigator.walker.robot, arrays["qpos"], arrays["qvel"])
    steps, new = decide_steps(
        navigator,
        StepRequest(from_named(GUIDANCE, arrays, "way"), arrays["stop"]),
        posture_of(terms, arrays["touching"]),
        from_named(CLOCK, arrays, "clock"),
        from_named(step_template(navigator), arrays),
    )
    return {"new": new, **named_arrays(steps)}


def step_template(navigator: Navigator) -> StepMemory:
    return jax.eval_shape(lambda base: start_steps(navigator, base), shape_of((3,)))


def _frame_memory(navigator: Navigator) -> FrameMemory:
    return jax.eval_shape(lambda base: start_frames(navigator, base), shape_of((3,)))


def _control_memory(navigator: Navigator) -> ControlMemory:
    robot = navigator.walker.robot
    velocities = jnp.zeros(robot.motor_moments.shape[1])
    return jax.eval_shape(lambda qpos, qvel: _initial_memory(navigator, qpos, qvel), robot.home, velocities)


def _initial_memory(navigator: Navigator, qpos: Float[Array, " nq"], qvel: Float[Array, " nv"]) -> ControlMemory:
    terms = rigid_body_terms(navigator.walker.robot, qpos, qvel)
    zero = jnp.zeros((), jnp.int32)
    return ControlMemory(
        controller=initial_controller(navigator.walker.controller, terms),
        plan=start_steps(navigator, terms.com).plan,
        plan_number=zero,
        stopping=jnp.asarray(False),
        touchdowns=zero,
    )


def command_template(navigator: Navigator) -> PlanCommand:
    number = shape_of((), jnp.int32)
    return PlanCommand(step_template(navigator).plan, number, shape_of((), bool), number)


def _where(chosen: Bool[Array, ""], new: FootstepPlan, old: FootstepPlan) -> FootstepPlan:
    return jax.tree.map(lambda a, b: jnp.where(chosen, a, b), new, old)
