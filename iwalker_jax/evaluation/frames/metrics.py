"""Metrics of a planner on recorded frames: the paper's three, the H-LIP cost, and the truth about the scene."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.geometry import arc_length, interpolate_along, resample_by_arc_length, safe_norm, to_world
from iwalker_jax.optimization import initial_state_from_reference, solve_step_mpc, solve_unicycle
from iwalker_jax.perception import PUBLISHED_GRID, UNREACHABLE, sample_bilinear
from iwalker_jax.planning import PlannerConfig, PlannerModels, RobotState, pre_impact_planes
from iwalker_jax.scenes import RouteMap, SceneArrays, cost_at, obstacle_distance, straight_line_clearance

GOAL_TOLERANCE = 0.3
"""[m] from the goal within which a path counts as reaching it."""

MIN_PROGRESS = 0.1
"""[m] by which a path must shorten the route to a goal out of view: a footstep."""

_PUBLISHED_STEPS, _PUBLISHED_STEP = 150, 0.01
"""Step centres at which the paper sums its collision map, and the distance from one to the next [m]."""


class PlanMetrics(NamedTuple):
    """What one frame's plan is worth by its own maps, as the paper measures it.

    Attributes:
        feasibility: 1000 x mean over 100 x 3 coordinates (z = 0) of the squared distance between path and unicycle
            optimum [1000 m^2].
        collision: sum of the published map's values at the predicted footsteps.
        collision_published: the same sum at 150 step centres, 1 cm from one to the next along the path, as published.
        stability: 1000 x variance of the waypoint intervals divided by their mean.
        hlip_cost: cost of the step MPC's plan that follows the predicted footsteps.
    """

    feasibility: Float[Array, ""]
    collision: Float[Array, ""]
    collision_published: Float[Array, ""]
    stability: Float[Array, ""]
    hlip_cost: Float[Array, ""]


class TrueMetrics(NamedTuple):
    """What one frame's plan is worth by the scene's ground truth.

    Attributes:
        path_collides: the body's footprint touches an obstacle somewhere on the path.
        footsteps_in_collision: share of the predicted footsteps where the footprint touches.
        path_in_collision: share of the path's length where the footprint touches.
        goal_distance: [m] from the path's end to the goal.
        progress: [m] by which the shortest route to the goal shortens from the path's start to its end.
        remaining: [m] shortest route from the path's start.
        efficiency: shortest route from the start, divided by the path's length plus the route from its end.
    """

    path_collides: Bool[Array, ""]
    footsteps_in_collision: Float[Array, ""]
    path_in_collision: Float[Array, ""]
    goal_distance: Float[Array, ""]
    progress: Float[Array, ""]
    remaining: Float[Array, ""]
    efficiency: Float[Array, ""]


def plan_metrics(
    path: Float[Array, "n 2"],
    waypoints: Float[Array, "k 2"],
    footsteps: Float[Array, "m 2"],
    state: RobotState,
    published: Float[Array, "rows columns"],
    planner: PlannerConfig,
    models: PlannerModels,
) -> tuple[PlanMetrics, Float[Array, "n 2"]]:
    """The paper's metrics of one plan, and the path after the unicycle MPC.

    Args:
        path: [m], from the robot, uniform in the spline's parameter.
        waypoints: [m], without the origin.
        footsteps: [m] predicted.
        state: of the robot.
        published: the frame's published collision map.
        planner: pendulum and weights of the step MPC.
        models: the unicycle's.
    """
    reference = resample_by_arc_length(path, path.shape[0])
    tracked = solve_unicycle(reference, initial_state_from_reference(reference), models.unicycle, "stopped").value.path
    feasibility = 1000.0 * jnp.sum((path - tracked) ** 2) / (3 * path.shape[0])
    centres = _PUBLISHED_STEP * (jnp.arange(_PUBLISHED_STEPS, dtype=path.dtype) + 1.0)
    along = interpolate_along(arc_length(path), path, centres)
    collision, collision_published = (
        jnp.sum(sample_bilinear(published, PUBLISHED_GRID, places, outside="clamp")) for places in (footsteps, along)
    )
    knots = jnp.concatenate([jnp.zeros_like(waypoints[:1]), waypoints])
    segments = safe_norm(jnp.diff(knots, axis=0))
    stability = 1000.0 * jnp.var(segments / jnp.maximum(jnp.mean(segments), 1e-6))
    planes = pre_impact_planes(state, planner.hlip)
    steps = solve_step_mpc(footsteps, planes, planner.tracking_pendulum, planner.step_weights, "stopped")
    return PlanMetrics(feasibility, collision, collision_published, stability, steps.value.cost), tracked


def true_metrics(
    path: Float[Array, "n 2"],
    footsteps: Float[Array, "m 2"],
    goal: Float[Array, " 2"],
    pose: Float[Array, " 3"],
    scene: SceneArrays,
    shortest: RouteMap,
    body_radius: float | Float[Array, ""],
) -> TrueMetrics:
    """Ground truth of one plan.

    Args:
        path, footsteps, goal: [m] base frame.
        pose: base in the scene's world frame.
        scene: of the frame.
        shortest: `shortest_distance` map of this goal.
        body_radius: [m] of the footprint.
    """
    even = to_world(pose, resample_by_arc_length(path, path.shape[0]))
    on_path = obstacle_distance(scene, even) < body_radius
    on_steps = obstacle_distance(scene, to_world(pose, footsteps)) < body_radius
    start, end = cost_at(shortest, even[0]), cost_at(shortest, even[-1])
    # An end inside an obstacle is no progress at all.
    progress = jnp.where(end >= UNREACHABLE, -jnp.inf, start - end)
    walked = arc_length(path)[-1]
    return TrueMetrics(
        path_collides=jnp.any(on_path),
        footsteps_in_collision=jnp.mean(on_steps.astype(path.dtype)),
        path_in_collision=jnp.mean(on_path.astype(path.dtype)),
        goal_distance=safe_norm(path[-1] - goal),
        progress=progress,
        remaining=start,
        efficiency=jnp.where(end >= UNREACHABLE, 0.0, start / jnp.maximum(walked + end, 1e-6)),
    )


def goal_in_view(
    goal: Float[Array, " 2"],
    pose: Float[Array, " 3"],
    scene: SceneArrays,
    half_view: float | Float[Array, ""],
    range_limit: float,
) -> Bool[Array, ""]:
    """Whether a goal lies in the camera's field of view with nothing in between, by ground truth.

    Args:
        goal: [m] base frame.
        pose: base in the world.
        scene: of the frame.
        half_view: [rad] half the horizontal field of view.
        range_limit: [m] of the local map.
    """
    bearing = jnp.arctan2(goal[1], goal[0])
    clear = straight_line_clearance(scene, pose[:2], to_world(pose, goal)) > 0.0
    return clear & (jnp.abs(bearing) < half_view) & (safe_norm(goal) < range_limit)


def goal_served(metrics: TrueMetrics, in_view: Bool[Array, "*n"]) -> Bool[Array, "*n"]:
    """Whether each plan does what its goal asks without touching anything: reach it if it is in view, else make
    progress along the route."""
    reached = metrics.goal_distance < GOAL_TOLERANCE
    free = ~metrics.path_collides
    return free & jnp.where(in_view, reached, reached | (metrics.progress > MIN_PROGRESS))
