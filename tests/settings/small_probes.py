"""Probes of the configurations of perception, planning, optimisation and the losses."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import nnx

from iwalker_jax.geometry.body import BodyParameters
from iwalker_jax.optimization.qp.problem import QuadraticProgram
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.qp.solver import solve_qp
from iwalker_jax.optimization.steps.hlip import HlipParameters
from iwalker_jax.optimization.steps.mpc import solve_step_mpc
from iwalker_jax.optimization.steps.mpc_bounded import solve_bounded_step_mpc
from iwalker_jax.optimization.steps.problem import StepMpcWeights
from iwalker_jax.optimization.steps.reach import StepReach
from iwalker_jax.optimization.unicycle.model import UnicycleParameters, initial_state_from_reference
from iwalker_jax.optimization.unicycle.mpc import solve_unicycle
from iwalker_jax.perception.camera import CameraMount, Intrinsics, backproject
from iwalker_jax.perception.collision_map import ObstacleParameters
from iwalker_jax.perception.floor import FloorParameters, MountUncertainty, align_to_floor, fit_floor
from iwalker_jax.perception.grid import DEFAULT_GRID, GridSpec
from iwalker_jax.perception.local_map import frame_cells
from iwalker_jax.perception.soft_map import SoftOccupancy, soft_map
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost
from iwalker_jax.planning.footsteps import nominal_footsteps
from iwalker_jax.planning.goal_scan import GoalScan, goal_scan
from iwalker_jax.planning.ipath import IPath, IPathConfig
from iwalker_jax.planning.istepper import IStepper, IStepperConfig
from iwalker_jax.planning.robot_state import RobotState, StepGeometry
from tests.settings.mechanism import Probe

MOUNT = jnp.asarray([0.58, 0.26, 0.05, 0.03, 0.02])
PATH = jnp.stack([jnp.linspace(0.0, 2.0, 100), 0.3 * jnp.sin(jnp.linspace(0.0, 3.0, 100))], axis=1)
STATE = RobotState(jnp.asarray([0.01, -0.05]), jnp.asarray([0.1, 0.02]), jnp.ones(()), jnp.asarray(0.05))
SMALL = Intrinsics(width=96, height=64, fx=48.0, fy=48.0, cx=47.5, cy=31.5)
STEPS = jnp.stack([0.08 * (1.0 + jnp.arange(6)), jnp.asarray([-0.05, 0.05] * 3)], axis=1)
PLANES = jnp.asarray([[0.0, 0.01, 0.2], [0.05, 0.02, 0.1]])


def depth_image(camera: Intrinsics = SMALL) -> jax.Array:
    """[m] of anything."""
    return jnp.asarray(np.random.default_rng(0).uniform(0.5, 4.0, (camera.height, camera.width)), jnp.float32)


def one_row(state: RobotState) -> RobotState:
    """A batch of one state."""
    return jax.tree.map(lambda leaf: leaf[None], state)


def box_program() -> QuadraticProgram:
    """A small strictly convex program with two-sided rows."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    matrix, rows = root @ root.T + np.eye(4), rng.normal(size=(6, 4))
    arrays = matrix, rng.normal(size=4), rows, -np.full(6, 0.1), np.full(6, 0.1)
    return QuadraticProgram(*(jnp.asarray(array, jnp.float32) for array in arrays))


def waypoints(config: IPathConfig) -> Any:
    """iPath's answer without a mount, and its size."""
    network = IPath(config, nnx.Rngs(0))
    return network(depth_image(config.camera)[None], jnp.asarray([[9.0, 1.0]]))


def unicycle_path(parameters: UnicycleParameters) -> Any:
    """The unrolled optimum, which takes both kinds of iterations."""
    return solve_unicycle(PATH, initial_state_from_reference(PATH), parameters, "unrolled")


LIGHT = IPathConfig(camera=SMALL, trunk_width=4, hidden=8)

PROBES = {
    BodyParameters: Probe(
        lambda c: (c.radius, c.layout_radius, c.route_radius, c.gap_radius, c.step_over), BodyParameters(), traced=False
    ),
    HlipParameters: Probe(lambda c: solve_step_mpc(STEPS, PLANES, c, StepMpcWeights()).value, HlipParameters()),
    StepMpcWeights: Probe(lambda c: solve_step_mpc(STEPS, PLANES, HlipParameters(), c).value, StepMpcWeights()),
    StepReach: Probe(
        lambda c: solve_bounded_step_mpc(STEPS, PLANES, jnp.asarray(1.0), reach=c).value,
        StepReach(),
    ),
    UnicycleParameters: Probe(
        unicycle_path,
        UnicycleParameters(),
        changes={"turn_bound": 1.0, "acceleration_bound": 1.0, "speed_bound": 1.0, "method": "ilqr"},
        followed=False,
    ),
    QpSettings: Probe(
        lambda c: solve_qp(box_program(), None, c, "implicit").value,
        QpSettings(),
        changes={"method": "admm", "pivots": 3, "tolerance": 1e-3},
        followed=False,
    ),
    Intrinsics: Probe(lambda c: backproject(depth_image(c), c, MOUNT), SMALL),
    CameraMount: Probe(lambda c: c.as_array(), CameraMount(), traced=False),
    GridSpec: Probe(lambda c: c.centres(), DEFAULT_GRID, traced=False),
    ObstacleParameters: Probe(
        lambda c: frame_cells(depth_image(), MOUNT, SMALL, DEFAULT_GRID, c), ObstacleParameters()
    ),
    SoftOccupancy: Probe(lambda c: soft_map(depth_image(), MOUNT, SMALL, soft=c), SoftOccupancy()),
    FloorParameters: Probe(lambda c: fit_floor(depth_image(), SMALL, c), FloorParameters()),
    MountUncertainty: Probe(
        lambda c: align_to_floor(depth_image(), MOUNT + jnp.asarray([0.004, 0.01, 0.01, 0.0, 0.0]), SMALL, c),
        MountUncertainty(),
    ),
    TraversalParameters: Probe(
        lambda c: traversal_cost(jnp.linspace(-0.2, 1.0, 9), jnp.full(9, 0.3), c), TraversalParameters()
    ),
    GoalScan: Probe(
        lambda c: goal_scan(backproject(depth_image(), SMALL, MOUNT), jnp.ones((64, 96)), jnp.asarray([1.0, 0.0]), c),
        GoalScan(),
        followed=False,
    ),
    IPathConfig: Probe(waypoints, dataclasses.replace(LIGHT, even=False), changes={"variant": "paper"}),
    IStepperConfig: Probe(
        lambda c: IStepper(c, StepGeometry(), nnx.Rngs(0))(PATH[None], one_row(STATE)),
        IStepperConfig(hidden=8),
        changes={"second_hidden": 5},
    ),
    StepGeometry: Probe(lambda c: nominal_footsteps(PATH, jnp.ones(()), c), StepGeometry()),
}
