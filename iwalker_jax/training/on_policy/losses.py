"""What candidates of a path cost on the true scene, and what the network learns from it.

The cost is that of the published planner's upper level (obstacles, goal, trackability), but judged by the scene itself
instead of one frame's map: the way along the path and the best way on from its end, minus the best way from its start.
Of several candidates the best one is taught most, so that they come to stand for different ways round.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.geometry import safe_norm, to_world
from iwalker_jax.perception import traversal_cost
from iwalker_jax.planning import MemoryIPath, PathCandidates, waypoints_to_path
from iwalker_jax.surrogate import TrueFields, Visit, sample_fields, way_to_go
from iwalker_jax.training.losses import unicycle_tracking
from iwalker_jax.training.on_policy.config import OnPolicyConfig

_POINTS = 33  # of a path on which the scene is sampled: every 5 cm
_FARTHEST = 200.0  # [m] of way, beyond which no end of a path is worse


class CandidateLosses(NamedTuple):
    """Of the candidates of one view.

    Attributes:
        cost: (candidates,) [m] beyond the best way, with the turn to begin it and its bends.
        touches: (candidates,) whether the body meets an obstacle on the way.
    """

    cost: Float[Array, "*batch candidates"]
    touches: Bool[Array, "*batch candidates"]


class ProposalReport(NamedTuple):
    """What a batch's candidates are like.

    Attributes:
        best: [m] mean cost of each view's best candidate; chosen: median cost of the one it expects to be cheapest.
        touching: share of those that meet an obstacle.
        cost_error: mean error of the predicted log cost.
        tracking: [m^2] mean squared distance of paths to their unicycle optima.
    """

    best: Float[Array, ""]
    chosen: Float[Array, ""]
    touching: Float[Array, ""]
    cost_error: Float[Array, ""]
    tracking: Float[Array, ""]


def candidate_losses(
    config: OnPolicyConfig, fields: TrueFields, visit: Visit, waypoints: Float[Array, "candidates k 2"]
) -> CandidateLosses:
    """Costs of one view's candidates on its true scene; differentiable in the waypoints.

    Args:
        config: weights and grids.
        fields: of the scenes.
        visit: where the view was taken.
        waypoints: [m] in the view's axes.
    """
    weights, grids = config.weights, config.grids
    corner = fields.scenes.bounds[visit.scene, :2]
    frame = jnp.append(visit.origin - corner, visit.axis)
    points = to_world(frame, waypoints_to_path(waypoints, _POINTS))
    clearance = sample_fields(fields.clearance, visit.scene, points, grids.resolution)
    metre = traversal_cost(clearance, jnp.zeros_like(clearance), grids.traversal)
    lengths = safe_norm(jnp.diff(points, axis=1))
    spent = jnp.sum(0.5 * (metre[:, 1:] + metre[:, :-1]) * lengths, axis=1)
    ends = jnp.concatenate([points[:, -1], frame[None, :2]])
    to_go = jnp.minimum(way_to_go(grids, fields, visit.scene, visit.goal, ends), _FARTHEST)
    first = waypoints[:, 0] / (safe_norm(waypoints[:, 0])[:, None] + 1e-6)
    turning = 0.5 * (1.0 - first @ visit.view.heading)
    knots = jnp.concatenate([jnp.zeros_like(waypoints[:, :1]), waypoints], axis=1)
    bends = jnp.sum(jnp.diff(knots, n=2, axis=1) ** 2, axis=(1, 2))
    cost = spent + to_go[:-1] - jax.lax.stop_gradient(to_go[-1]) + weights.turn * turning + weights.bend * bends
    # Where the goal is near, what lies beyond it on the path is not walked.
    touches = jnp.min(clearance[:, 1 : 3 * _POINTS // 4], axis=1) < config.robot.body_radius
    return CandidateLosses(cost, touches)


def proposal_loss(
    network: MemoryIPath, config: OnPolicyConfig, fields: TrueFields, visits: Visit, spread: Float[Array, ""]
) -> tuple[Float[Array, ""], ProposalReport]:
    """What a batch of views teaches the network.

    Args:
        network: that proposes.
        config: weights, grids and the path MPC.
        fields: of the scenes.
        visits: with a batch axis.
        spread: () share of what all candidates learn alike.
    """
    weights = config.weights
    candidates = network(visits.view)
    cost, touches = jax.vmap(lambda visit, ways: candidate_losses(config, fields, visit, ways))(
        visits, candidates.waypoints
    )
    known = jax.lax.stop_gradient(cost)
    share = (1 - spread) * jax.nn.softmax(-known / weights.temperature, axis=-1) + spread / cost.shape[-1]
    most = weights.compressed_from
    compressed = jnp.where(cost < most, cost, most + jnp.log1p(jnp.maximum(cost - most, 0.0)))
    planned = jnp.mean(jnp.sum(share * compressed, axis=-1))
    cost_error = jnp.mean(jnp.abs(candidates.log_cost - jnp.log1p(jnp.clip(known, -0.5, _FARTHEST))))
    fear = jnp.mean(jnp.logaddexp(0.0, candidates.fear) - touches * candidates.fear)
    tracking = _tracking(config, candidates, known)
    chosen = jnp.argmin(candidates.log_cost, axis=-1)[:, None]
    loss = planned + weights.cost * cost_error + weights.fear * fear + weights.tracking * tracking
    return loss, ProposalReport(
        best=jnp.mean(jnp.min(known, axis=-1)),
        chosen=jnp.median(jnp.take_along_axis(known, chosen, axis=-1)),
        touching=jnp.mean(jnp.take_along_axis(touches, chosen, axis=-1)),
        cost_error=cost_error,
        tracking=tracking,
    )


def _tracking(
    config: OnPolicyConfig, candidates: PathCandidates, cost: Float[Array, "batch candidates"]
) -> Float[Array, ""]:
    """[m^2] of the best candidates of some views to their unicycle optima; zero where those have no derivative."""
    every = config.weights.tracking_every
    best = jnp.argmin(cost, axis=-1)[::every, None, None, None]
    waypoints = jnp.take_along_axis(candidates.waypoints[::every], best, axis=1)[:, 0]

    def one(path: Float[Array, "n 2"]) -> Array:
        apart, trusted = unicycle_tracking(path, config.unicycle)
        return jnp.where(trusted, apart, 0.0)

    return jnp.mean(jax.vmap(one)(waypoints_to_path(waypoints)))
