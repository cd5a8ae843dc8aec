"""The table of what runs on a robot: each function with its inputs' shapes, its rate and its purpose."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import jax
import jax.numpy as jnp
from jax import export
from jaxtyping import Array

from iwalker_jax.constants import TIME_STEP
from iwalker_jax.deployment.functions import (
    CLOCK,
    GUIDANCE,
    MEMORY,
    Arrays,
    camera_frame,
    command_template,
    control_tick,
    plan_footsteps,
    shape_of,
    start_control,
    start_frame,
    step_template,
)
from iwalker_jax.deployment.named_arrays import from_named, named_arrays
from iwalker_jax.navigation.navigators import Navigator
from iwalker_jax.planning import PATH_POINTS, RobotState
from iwalker_jax.tasks.task import GOAL_CAPACITY


@dataclass(frozen=True)
class ExportedFunction:
    """A function that runs on a robot.

    Attributes:
        function: named arrays to named arrays.
        inputs: their shapes; those of the networks have a symbolic batch.
        rate: [Hz] at which it is called; None once, or as wanted.
        purpose: in a sentence.
    """

    function: Callable[[Arrays], Arrays]
    inputs: Mapping[str, jax.ShapeDtypeStruct]
    rate: float | None
    purpose: str


def exported_functions(navigator: Navigator) -> dict[str, ExportedFunction]:
    """All functions of a robot with a policy, by name."""
    robot = navigator.walker.robot
    state = {"qpos": shape_of(robot.home.shape), "qvel": shape_of(robot.motor_moments.shape[1:])}
    measured = {**state, "touching": shape_of((2,), bool)}
    start = jax.eval_shape(lambda arrays: start_frame(navigator, arrays), state)
    control = jax.eval_shape(lambda arrays: start_control(navigator, arrays), state)
    per_second = 1 / TIME_STEP
    return {
        "start_control": ExportedFunction(
            lambda arrays: start_control(navigator, arrays),
            state,
            None,
            "The controller's memory of a robot that stands on both feet.",
        ),
        "control": ExportedFunction(
            lambda arrays: control_tick(navigator, arrays),
            {
                **measured,
                **named_arrays(command_template(navigator), "command"),
                "halt": shape_of((), bool),
                **_memory(control),
            },
            per_second,
            "One tick of the whole-body controller: state and footsteps to motor torques.",
        ),
        "start_frame": ExportedFunction(
            lambda arrays: start_frame(navigator, arrays),
            state,
            None,
            "The memory of a robot that has seen nothing yet, and the spot where it stands.",
        ),
        "frame": ExportedFunction(
            lambda arrays: camera_frame(navigator, arrays),
            {**_frame_shapes(navigator, state), **_memory(start)},
            1 / navigator.frame_time,
            "One camera frame: depth and state to the way to go.",
        ),
        "footsteps": ExportedFunction(
            lambda arrays: plan_footsteps(navigator, arrays),
            _footstep_shapes(navigator, measured),
            per_second / navigator.loop.ticks_per_check,
            "Whether footsteps are due, and which: a step takes place about four times a second.",
        ),
        **_network_stages(navigator),
    }


def _network_stages(navigator: Navigator) -> dict[str, ExportedFunction]:
    """The two networks alone, for any number of rows at a time."""
    planner = navigator.planner
    shape = (navigator.intrinsics.height, navigator.intrinsics.width)
    (batch,) = export.symbolic_shape("batch")

    def ipath(arrays: Arrays) -> Arrays:
        # Row by row, because the network chooses between equal sums by the number of rows.
        def one(depth: Array, goal: Array, mount: Array) -> Arrays:
            output = planner.merge().ipath(depth[None], goal[None], mount[None])
            return jax.tree.map(lambda leaf: leaf[0], output._asdict())

        return jax.vmap(one)(arrays["depth"], arrays["goal"], arrays["mount"])

    def istepper(arrays: Arrays) -> Arrays:
        state = from_named(_ROBOT_STATE, arrays)
        return {"footsteps": planner.merge().istepper(arrays["path"], state)}

    rows = {name: shape_of((batch, *leaf.shape)) for name, leaf in named_arrays(_ROBOT_STATE).items()}
    return {
        "ipath": ExportedFunction(
            ipath,
            {"depth": shape_of((batch, *shape)), "goal": shape_of((batch, 2)), "mount": shape_of((batch, 5))},
            None,
            "iPath alone: depth images and goals to waypoints.",
        ),
        "istepper": ExportedFunction(
            istepper,
            {"path": shape_of((batch, PATH_POINTS, 2)), **rows},
            None,
            "iStepper alone: paths and robot states to footsteps.",
        ),
    }


def _memory(arrays: Arrays) -> Arrays:
    return {name: array for name, array in arrays.items() if name.startswith(f"{MEMORY}.")}


_ROBOT_STATE = RobotState(shape_of((2,)), shape_of((2,)), shape_of(()), shape_of(()))


def _frame_shapes(navigator: Navigator, state: Arrays) -> Arrays:
    return {
        "depth": shape_of((navigator.intrinsics.height, navigator.intrinsics.width)),
        "image.qpos": state["qpos"],
        "image.qvel": state["qvel"],
        **state,
        "time": shape_of(()),
        "goals": shape_of((GOAL_CAPACITY, 2)),
        "goal_count": shape_of((), jnp.int32),
    }


def _footstep_shapes(navigator: Navigator, measured: Arrays) -> Arrays:
    return {
        **named_arrays(GUIDANCE, "way"),
        "stop": shape_of((), bool),
        **measured,
        **named_arrays(CLOCK, "clock"),
        **named_arrays(step_template(navigator)),
    }
