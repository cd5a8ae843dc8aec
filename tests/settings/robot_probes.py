"""Probes of the configurations of control, estimation, walking, navigation and the depth camera."""

import dataclasses
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from bruce_model import load_mujoco
from iwalker_jax.control.controller import Controller, control_step, initial_controller, make_controller
from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.control.gait import advance_gait, initial_gait
from iwalker_jax.control.gait_state import Posture
from iwalker_jax.control.parameters import GaitParameters, LegEffect, WholeBodyParameters
from iwalker_jax.control.stepping import stepping_gains
from iwalker_jax.estimation import (
    EstimatorParameters,
    SensorNoise,
    estimate_step,
    initial_estimate,
    initial_sensors,
    simulate_sensors,
)
from iwalker_jax.navigation.camera import RobotCamera, load_camera
from iwalker_jax.navigation.camera_health import HealthParameters, check_camera, healthy_camera
from iwalker_jax.navigation.closed_loop import camera_frame, start_episode
from iwalker_jax.navigation.depth_camera import start_depth_camera, take_depth
from iwalker_jax.navigation.faults import make_faults
from iwalker_jax.navigation.guide import GuidanceParameters, Observation, guide, start_guide
from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    MapMemoryParameters,
    RouteMemoryParameters,
    WideMemoryParameters,
    empty_memory,
    empty_route_memory,
    memory_cells,
    update_memory,
    update_route_memory,
)
from iwalker_jax.navigation.navigators import LoopParameters, Navigator, make_navigator
from iwalker_jax.navigation.path_band import BandParameters, safe_path, way_to_room
from iwalker_jax.navigation.step_planning import PursuitParameters, held_on_spot, pursue
from iwalker_jax.perception import ROUTE_POINTS, FrameCells, ScanParameters
from iwalker_jax.perception.grid import DEFAULT_GRID
from iwalker_jax.planning import MapViewParameters, MemoryIPath, MemoryIPathConfig
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.planning.robot_state import StepGeometry
from iwalker_jax.robot.leg_kinematics import LegKinematics, load_leg_kinematics
from iwalker_jax.robot.model import RobotModel, load_robot_model
from iwalker_jax.robot.rigid_body import rigid_body_terms
from iwalker_jax.scenes.depth_noise import DepthNoise
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task, stack_tasks
from iwalker_jax.walking.commands import Motion, make_walk
from iwalker_jax.walking.setup import Disturbances, sample_conditions
from tests.settings.mechanism import Probe
from tests.settings.small_probes import LIGHT, MOUNT, PATH, SMALL, depth_image

ROOM = Scene("room", "test", np.array([[2.5, 0.2, 0.5, 0.3, 0.4, 0.5, 0.2]]), np.zeros((0, 5)), (-2, -2, 5, 2), 2.5)


def fields_of(kind: type, of: type) -> tuple[str, ...]:
    """Names of a class's fields whose defaults are of a type."""
    return tuple(f.name for f in dataclasses.fields(kind) if type(f.default) is of)


@cache
def bruce() -> RobotModel:
    return load_robot_model(load_mujoco())


@cache
def controller() -> Controller:
    return make_controller(bruce())


@cache
def legs() -> LegKinematics:
    return load_leg_kinematics(load_mujoco())


@cache
def camera() -> RobotCamera:
    return load_camera(load_mujoco())


@cache
def navigator() -> Navigator:
    """A robot with small untrained networks."""
    planner = Planner(PlannerConfig(ipath=LIGHT), nnx.Rngs(0))
    return make_navigator("default", planner)


def one_tick(controlled: Controller) -> Any:
    """One tick of the controller, its quadratic program and its memory, in a state that is at rest in nothing."""
    rng = np.random.default_rng(0)
    qpos = jnp.asarray(np.asarray(bruce().home) + np.append(np.zeros(7), rng.uniform(-0.1, 0.1, 16)), jnp.float32)
    qvel = jnp.asarray(rng.normal(0, 0.2, 22), jnp.float32)
    terms = rigid_body_terms(bruce(), qpos, qvel)
    plan = FootstepPlan(jnp.ones((8, 2)), jnp.zeros(8), jnp.asarray(1), jnp.asarray(8))
    memory = initial_controller(controlled, terms)
    torques, memory, info = control_step(controlled, terms, (qpos[17:], qvel[16:]), jnp.ones(2, bool), plan, memory)
    return torques, memory, info.program, info.reference


def gait_tick(gait: GaitParameters) -> Any:
    """Two ticks of the step clock from standing; gains are those of the default gait."""
    feet = jnp.asarray([[0.0, -0.05, 0.0], [0.02, 0.05, 0.0]])
    posture = Posture(
        jnp.asarray([0.01, 0.0, 0.365]), jnp.full(3, 0.1), feet, jnp.asarray([0.1, 0.0]), jnp.ones(2, bool)
    )
    plan = FootstepPlan(jnp.ones((8, 2)), jnp.zeros(8), jnp.asarray(1), jnp.asarray(8))
    state, reference = initial_gait(gait, posture), None
    for _ in range(2):
        state, reference = advance_gait(gait, controller().gains, 1.0, 0.002, posture, plan, state)
    return state, reference


def sensed(noise: SensorNoise) -> Any:
    """The first readings of a moving robot."""
    qpos, qvel = jnp.asarray(bruce().home, jnp.float32), jnp.full(22, 0.1)
    start = initial_sensors(noise, jax.random.key(0), qpos)
    return simulate_sensors(noise, start, qpos, qvel, jnp.ones(3))


def estimated(parameters: EstimatorParameters) -> Any:
    """One step of the estimator on readings of everything."""
    qpos, qvel = jnp.asarray(bruce().home, jnp.float32), jnp.full(22, 0.1)
    start = initial_estimate(legs(), qpos, qvel, parameters=parameters)
    return estimate_step(parameters, legs(), start, sensed(SensorNoise())[1], jnp.asarray([1.0, 0.0]))


def photographed(noise: DepthNoise) -> Any:
    """A noisy image of a room, and what lasts of its errors."""
    qpos = jnp.asarray(bruce().home, jnp.float32)
    return take_depth(
        camera(), SMALL, noise, ROOM.arrays(), qpos, start_depth_camera(camera(), qpos, jax.random.key(0))
    )


def mapped(parameters: MapMemoryParameters) -> Any:
    """A map after one frame."""
    cells = jnp.zeros(DEFAULT_GRID.shape, bool)
    base = jnp.asarray([0.1, 0.2, 0.3])
    memory = update_memory(parameters, empty_memory(parameters, base[:2]), base, FrameCells(cells, ~cells, ~cells))
    return memory, memory_cells(parameters, memory)


def framed(**changes: Any) -> Any:
    """A camera frame of an episode from its start."""
    changed = dataclasses.replace(navigator(), **changes)
    task, conditions, state = started(changed)
    return camera_frame(changed, task, conditions, make_faults(), state, False)


def started(robot: Navigator) -> tuple[Any, Any, Any]:
    """A task, the conditions that it meets, and its episode's start."""
    task = Task("to the end", ROOM, (0.0, 0.0, 0.0), np.array([[1.5, 0.0]]), 9.0)
    arrays = jax.tree.map(lambda leaf: leaf[0], stack_tasks([task]))
    conditions = jax.tree.map(lambda leaf: leaf[0], conditions_of(Disturbances()))
    return arrays, conditions, start_episode(robot, arrays, conditions)


@cache
def conditions_of(disturbances: Disturbances) -> Any:
    return sample_conditions(bruce(), disturbances, 3, 0)


def prepare() -> None:
    """Make what probes share before any of them is traced."""
    navigator(), memory_ipath(), controller(), legs(), camera(), conditions_of(Disturbances())


def guided(parameters: GuidanceParameters) -> Any:
    """The way to a goal after one frame."""
    base = jnp.asarray([0.1, 0.2, 0.3])
    observation = Observation(depth_image(), MOUNT, base, jnp.asarray([6.0, 1.5]))
    aside = base[:2] + jnp.linspace(0.0, 2.0, ROUTE_POINTS)[:, None] * jnp.asarray([0.8, 0.6])
    memory = start_guide(parameters, base[:2])._replace(route=aside)
    return guide(parameters, navigator().planner.merge(), SMALL, memory, observation)


@cache
def memory_ipath() -> MemoryIPath:
    """A small untrained network."""
    return MemoryIPath(
        MemoryIPathConfig(MapViewParameters(bearings=8, rings=2), channels=4, hidden=8, judging=8), nnx.Rngs(0)
    )


def guided_by_memory(parameters: GuidanceParameters) -> Any:
    """The way that a network finds on the map after one frame."""
    base = jnp.asarray([0.1, 0.2, 0.3])
    observation = Observation(depth_image(), MOUNT, base, jnp.asarray([6.0, 1.5]))
    memory = start_guide(parameters, base[:2])
    return guide(parameters, navigator().planner.merge(), SMALL, memory, observation, memory_ipath())


def banded(parameters: BandParameters) -> Any:
    """A path through open floor, and the ways to room on slopes of clearance with and without enough of it."""
    x = DEFAULT_GRID.centres()[..., 0]
    rooms = [way_to_room(parameters, jnp.ones(2), slope * x, DEFAULT_GRID) for slope in (0.12, 0.2)]
    return safe_path(parameters, PATH, jnp.ones(DEFAULT_GRID.shape), DEFAULT_GRID), rooms


def routed(parameters: RouteMemoryParameters) -> Any:
    """The coarse map of a window in which everything is free."""
    window = MapMemoryParameters()
    cells = empty_memory(window, jnp.zeros(2))
    cells = cells._replace(evidence=cells.evidence - window.max_evidence)
    return update_route_memory(parameters, window, empty_route_memory(parameters, cells), cells)[0]


NOT_IN_A_TICK = ("hlip", "mpc", "horizon", "width", "speed")
PUSHED = Disturbances(push_impulse=1.0)
WALKED = Motion("straight", 0.2, distance=0.5)

PROBES = {
    GaitParameters: (
        Probe(
            gait_tick,
            GaitParameters(),
            only=tuple(f.name for f in dataclasses.fields(GaitParameters) if f.name not in NOT_IN_A_TICK),
        ),
        Probe(
            lambda c: make_walk(Motion("straight", distance=0.5), load_mujoco(), c)[:1],
            GaitParameters(),
            traced=False,
            only=("width", "speed"),
        ),
        Probe(lambda c: vars(stepping_gains(c)), GaitParameters(), traced=False, only=("hlip", "mpc", "horizon")),
    ),
    LegEffect: (
        Probe(
            lambda c: gait_tick(GaitParameters(leg_effect=c)),
            LegEffect(),
        ),
    ),
    WholeBodyParameters: (
        Probe(lambda c: one_tick(dataclasses.replace(controller(), tasks=c)), WholeBodyParameters()),
    ),
    EstimatorParameters: (Probe(estimated, EstimatorParameters()),),
    SensorNoise: (Probe(sensed, SensorNoise(), changes={"encoder_offset": 0.01}, followed=False),),
    DepthNoise: (Probe(photographed, DepthNoise(), changes={"edge_width": 12.0}, followed=False),),
    HealthParameters: (
        Probe(
            lambda c: check_camera(c, healthy_camera((4, 4), jnp.float32), jnp.ones((4, 4)), jnp.asarray(0.1)),
            HealthParameters(),
        ),
    ),
    RouteMemoryParameters: (Probe(routed, RouteMemoryParameters(), changes={"cells": 80}),),
    MapMemoryParameters: (Probe(mapped, MapMemoryParameters(), changes={"cells": 80}, followed=False),),
    BandParameters: (Probe(banded, BandParameters(), followed=False),),
    PursuitParameters: (
        Probe(
            lambda c: held_on_spot(
                c, pursue(c, StepGeometry(), PATH, jnp.ones(2), jnp.zeros(2), jnp.asarray(0.3)), jnp.ones(2)
            ),
            PursuitParameters(),
        ),
    ),
    LoopParameters: (
        Probe(lambda c: framed(loop=c), LoopParameters(), only=fields_of(LoopParameters, float)),
        Probe(
            lambda c: dataclasses.replace(navigator(), loop=c).frame_time,
            LoopParameters(),
            traced=False,
            only=("ticks_per_check", "checks_per_frame"),
        ),
        Probe(
            lambda c: len(started(dataclasses.replace(navigator(), loop=c))[2].underway),
            LoopParameters(),
            traced=False,
            only=("latency_frames",),
        ),
    ),
    Disturbances: (
        Probe(
            lambda c: sample_conditions(bruce(), c, 3, 0)._replace(key=0),
            PUSHED,
            changes={"push_axis": "y", "friction": (0.6, 0.9), "delay": (1, 3)},
            traced=False,
        ),
    ),
    Motion: (
        Probe(
            lambda c: make_walk(c, load_mujoco(), GaitParameters())[:1],
            WALKED,
            changes={"kind": "sideways", "step_length": 0.05, "seconds": 3.0, "width": 0.12},
            traced=False,
            refused={"file": (Path("steps.csv"), "reads no file")},
            only=("kind", "speed", "step_length", "distance", "width", "file"),
        ),
        Probe(
            lambda c: make_walk(c, load_mujoco(), GaitParameters())[:1],
            Motion("turn", seconds=4.0),
            traced=False,
            only=("turn", "seconds"),
        ),
    ),
    GuidanceParameters: (
        Probe(
            guided,
            GuidanceParameters(),
            changes={"source": "route"},
            only=("source", *fields_of(GuidanceParameters, float)),
        ),
        Probe(
            guided,
            GuidanceParameters(source="route"),
            changes={
                "memory": dataclasses.replace(GuidanceParameters().memory, decay=0.01),
                "routes": RouteMemoryParameters(rim=0.9),
            },
            only=("memory", "routes", "mount", "obstacles", "band", "traversal"),
        ),
        Probe(
            guided_by_memory,
            GuidanceParameters(source="memory", memory=SCAN_MEMORY),
            changes={"scan": ScanParameters(support=0.3), "wide": WideMemoryParameters(visit_radius=0.5)},
            only=("scan", "scan_stride", "wide"),
        ),
    ),
}
