"""Heuristic path losses of the iPlanner baseline: obstacle, height, motion, goal and fear, without any dynamics."""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from iwalker_jax.geometry import safe_norm
from iwalker_jax.perception import PUBLISHED_GRID, sample_bilinear
from iwalker_jax.training.maps import FrameMaps


@dataclass(frozen=True)
class HeuristicWeights:
    """Published weights of the iPlanner losses (its height term is zero on a flat floor) and the fear label's rule.

    Attributes:
        obstacle, motion, goal, fear: weights.
        fear_threshold: map value above which a path is labelled dangerous.
        fear_distance: [m] part of the path that the label looks at.
    """

    obstacle: float = 0.5
    motion: float = 2.0
    goal: float = 5.0
    fear: float = 1.0
    fear_threshold: float = 0.5
    fear_distance: float = 2.0


class HeuristicLosses(NamedTuple):
    """Terms for one frame, unweighted; there is no lower level, so they always count."""

    obstacle: Float[Array, ""]
    motion: Float[Array, ""]
    goal: Float[Array, ""]
    fear: Float[Array, ""]
    converged: Bool[Array, ""]


def heuristic_losses(
    path: Float[Array, "n 2"],
    fear: Float[Array, ""],
    goal: Float[Array, " 2"],
    maps: FrameMaps,
    weights: HeuristicWeights = HeuristicWeights(),
) -> HeuristicLosses:
    """Obstacle = sum of the published map's values on the path; motion = sum of | |desired step| - |step| | along it,
    desired being the straight line to the goal; goal = log(1 + distance of the end).

    Both sums run over every second point, because their published weights belong to a path of about fifty points.

    Args:
        path: (n, 2) [m].
        fear: logit.
        goal: (2,) [m].
        maps: of this frame.
        weights: the fear label's rule.
    """
    sparse = path[::2]
    cost = sample_bilinear(maps.published, PUBLISHED_GRID, sparse, outside="clamp")
    step = safe_norm(jnp.diff(sparse, axis=0))
    desired = safe_norm(goal) / step.shape[0]
    travelled = jnp.concatenate([jnp.zeros(1, path.dtype), jnp.cumsum(step)])
    near = travelled < weights.fear_distance
    danger = jax.lax.stop_gradient((jnp.max(jnp.where(near, cost, 0.0)) > weights.fear_threshold).astype(path.dtype))
    return HeuristicLosses(
        obstacle=jnp.sum(cost),
        motion=jnp.sum(jnp.abs(desired - step)),
        goal=jnp.log1p(safe_norm(goal - path[-1])),
        fear=jnp.logaddexp(0.0, fear) - danger * fear,
        converged=jnp.asarray(True),
    )


def heuristic_sum(losses: HeuristicLosses, weights: HeuristicWeights = HeuristicWeights()) -> Float[Array, ""]:
    """Weighted sum of the heuristic terms."""
    return (
        weights.obstacle * losses.obstacle
        + weights.motion * losses.motion
        + weights.goal * losses.goal
        + weights.fear * losses.fear
    )
