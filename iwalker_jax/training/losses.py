"""The upper-level losses: U_path teaches iPath alone, U_step teaches iStepper and, through the path, iPath."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import footstep_signs, resample_by_arc_length, safe_norm
from iwalker_jax.optimization import (
    GradientMode,
    UnicycleParameters,
    initial_state_from_reference,
    solve_step_mpc,
    solve_unicycle,
)
from iwalker_jax.perception import (
    DEFAULT_GRID,
    PUBLISHED_GRID,
    ROUTE_GRID,
    sample_bilinear,
    sample_smooth,
    traversal_cost,
)
from iwalker_jax.planning import PlannerConfig, PlannerModels, RobotState, closest_on_path, pre_impact_planes
from iwalker_jax.training.maps import FrameMaps

_ROUTE_SOFTNESS = 0.05  # [m] below which the distance to the route counts quadratically
_SHARES = ("converged", "solved")  # fields of losses that tell of the solvers


@dataclass(frozen=True)
class LossWeights:
    """Weights of the terms of U_path and U_step; zero switches a term off.

    Attributes:
        tracking: [1/m^2] MSE between the path and its unicycle optimum (eq. 4).
        route: [1/m] mean distance between the path and the best route through what the frame itself shows: the optimum
            of a third lower level, a geodesic planner. The costs below are flat behind obstacles and leave a path
            that starts through a wall there; this term shows it the way around.
        arrival: [1/m] distance between the path's end and that route's end.
        regret: [1/m] cost of the path plus the cost-to-go from its end, minus the cost-to-go from the robot: zero
            for the best route through the frame's own map. The published method replaces the last waypoint by the
            goal instead, which leaves goals inside, behind or beyond obstacles without an answer.
        progress: [1/m] cost-to-go from the path's end.
        clearance: worst body overlap along the path.
        fear: binary cross-entropy of the predicted fear.
        step_tracking: [1/m^2] MSE between the footsteps and their H-LIP optimum (eq. 9).
        step_width, step_length: [1/m^2] squared departures from the desired width and length (eqs. 12-14).
        step_collision: body overlap at the footsteps (U_ESDF).
        published_collision: published map's value at the footsteps, the paper's own U_ESDF.
        torque_margin, shortfall, placement: what the walking controller's whole-body QP and its stepping feedback say
            of the first footsteps (see `whole_body_losses.WholeBodyLosses`); part of U_step.
        step_to_path: whether U_step's gradient reaches iPath.
    """

    tracking: float = 40.0
    route: float = 3.0
    arrival: float = 2.0
    regret: float = 0.4
    progress: float = 0.1
    clearance: float = 3.0
    fear: float = 0.1
    step_tracking: float = 100.0
    step_width: float = 100.0
    step_length: float = 100.0
    step_collision: float = 2.0
    published_collision: float = 0.0
    torque_margin: float = 0.0
    shortfall: float = 0.0
    placement: float = 0.0
    step_to_path: bool = True

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        numbers = [value for value in vars(self).values() if not isinstance(value, bool)]
        if any(not value >= 0 for value in numbers):
            raise InputError("Loss weights must be finite and not negative.")

    @property
    def uses_whole_body(self) -> bool:
        """Whether any term needs the robot and its controller."""
        return max(self.torque_margin, self.shortfall, self.placement) > 0


class PathLosses(NamedTuple):
    """Terms of U_path for one frame, unweighted (see `LossWeights`), and whether the lower level converged."""

    tracking: Float[Array, ""]
    route: Float[Array, ""]
    arrival: Float[Array, ""]
    regret: Float[Array, ""]
    progress: Float[Array, ""]
    clearance: Float[Array, ""]
    fear: Float[Array, ""]
    converged: Bool[Array, ""]


class StepLosses(NamedTuple):
    """Terms of U_step for one frame, unweighted (see `LossWeights`), and whether the lower level converged."""

    step_tracking: Float[Array, ""]
    step_width: Float[Array, ""]
    step_length: Float[Array, ""]
    step_collision: Float[Array, ""]
    published_collision: Float[Array, ""]
    converged: Bool[Array, ""]


def overlap(clearance: Float[Array, "*n"], models: PlannerModels) -> Float[Array, "*n"]:
    """Squared lack of clearance, 1 where an obstacle reaches the body's axis, 0 beyond the safety margin."""
    wanted = models.traversal.body_radius + models.safety_margin
    return jnp.maximum(wanted - clearance, 0.0) ** 2 / wanted**2


def fear_loss(fear: Float[Array, ""], clearance: Float[Array, " n"], models: PlannerModels) -> Float[Array, ""]:
    """Binary cross-entropy of the fear logit of a path with the given clearance [m]: whether the body touches."""
    touches = jax.lax.stop_gradient((jnp.min(clearance) < models.traversal.body_radius).astype(clearance.dtype))
    return jnp.logaddexp(0.0, fear) - touches * fear


def path_losses(
    path: Float[Array, "n 2"],
    fear: Float[Array, ""],
    maps: FrameMaps,
    models: PlannerModels,
    gradient: GradientMode,
) -> PathLosses:
    """Terms of U_path.

    Args:
        path: (n, 2) [m] sampled uniformly in the spline's parameter, starting at the robot.
        fear: logit.
        maps: of this frame and goal.
        models: lower-level models.
        gradient: how the unicycle MPC is differentiated; `stopped` is the published way.
    """
    tracking, trusted = unicycle_tracking(path, models.unicycle, gradient)
    clearance = sample_smooth(maps.esdf, DEFAULT_GRID, path)
    unknown = sample_bilinear(maps.unknown, ROUTE_GRID, path, outside="clamp")
    # Through unseen space the route map may guess, but the path itself must not go: it ends where sight ends.
    cost = traversal_cost(clearance, unknown, models.traversal) + models.blind_walking * unknown
    lengths = safe_norm(jnp.diff(path, axis=0))
    spent = jnp.sum(0.5 * (cost[1:] + cost[:-1]) * lengths)
    to_go = sample_smooth(maps.to_go, ROUTE_GRID, path[-1])
    best = jax.lax.stop_gradient(sample_smooth(maps.to_go, ROUTE_GRID, path[0]))
    # A distance, not its square: between two ways around an obstacle the mean of both is the worst choice.
    apart = jnp.sum((path - resample_by_arc_length(maps.route, path.shape[0])) ** 2, axis=-1)
    apart = jnp.sqrt(apart + _ROUTE_SOFTNESS**2) - _ROUTE_SOFTNESS

    worst = jnp.max(overlap(clearance, models))
    return PathLosses(
        tracking=tracking,
        route=jnp.mean(apart),
        arrival=apart[-1],
        regret=spent + to_go - best,
        progress=to_go,
        clearance=worst,
        fear=fear_loss(fear, clearance, models),
        converged=trusted,
    )


def unicycle_tracking(
    path: Float[Array, "n 2"], unicycle: UnicycleParameters, gradient: GradientMode = "implicit"
) -> tuple[Float[Array, ""], Bool[Array, ""]]:
    """MSE [m^2] between a path and its unicycle optimum (eq. 4), and whether its derivative may be trusted."""
    # The reference is even in arc length and the prediction is not, so uneven waypoints are punished as well.
    reference = resample_by_arc_length(path, path.shape[0])
    solution = solve_unicycle(reference, initial_state_from_reference(reference), unicycle, gradient)
    return jnp.mean(jnp.sum((path - solution.value.path) ** 2, axis=-1)), solution.gradient_valid


def step_losses(
    footsteps: Float[Array, "m 2"],
    path: Float[Array, "n 2"],
    state: RobotState,
    maps: FrameMaps,
    planner: PlannerConfig,
    models: PlannerModels,
    gradient: GradientMode,
) -> StepLosses:
    """Terms of U_step.

    Args:
        footsteps: (m, 2) [m] predicted, base frame.
        path: the path that they follow.
        state: of this robot.
        maps: of this frame.
        planner: foot placement, pendulum and the step MPC's weights.
        models: lower-level models.
        gradient: how the step MPC is differentiated.
    """
    planes = pre_impact_planes(state, planner.hlip)
    solution = solve_step_mpc(footsteps, planes, planner.tracking_pendulum, planner.step_weights, gradient)
    tracking = jnp.mean(jnp.sum((footsteps - solution.value.footsteps) ** 2, axis=-1))

    geometry = planner.steps
    lateral, advance = closest_on_path(path, footsteps)
    signs = footstep_signs(state.stance_sign, geometry.count)
    width = jnp.mean((lateral - signs * geometry.width / 2) ** 2)
    # A path that ends early ends in stepping on the spot: the desired advance stops with it.
    wanted = jnp.minimum(geometry.length * (jnp.arange(geometry.count) + 1.0), advance.total)
    length = jnp.mean((jnp.diff(advance.along, prepend=0.0) - jnp.diff(wanted, prepend=0.0)) ** 2)

    collision = jnp.mean(overlap(sample_smooth(maps.esdf, DEFAULT_GRID, footsteps), models))
    published = jnp.sum(sample_bilinear(maps.published, PUBLISHED_GRID, footsteps, outside="clamp"))
    return StepLosses(tracking, width, length, collision, published, solution.gradient_valid)


def weighted_sum(losses: Any, weights: LossWeights) -> Float[Array, ""]:
    """Weighted sum of the terms of U_path, U_step or the whole-body losses; shares of usable rows are no terms."""
    terms = {name: value for name, value in losses._asdict().items() if name not in _SHARES}
    return sum((getattr(weights, name) * value for name, value in terms.items()), start=jnp.zeros(()))
