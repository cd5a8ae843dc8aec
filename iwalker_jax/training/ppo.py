"""Proximal policy optimisation (Schulman et al. 2017): the baseline that knows the lower level only as a reward.

iPath's waypoints are the mean of a Gaussian policy. A decision is an episode of its own: a plan is made for one
recorded frame, minus U_path of the sampled path is all that it earns, and no later frame depends on it. So there is no
discount, and the advantage is the return minus the critic's value. Where imperative learning follows the gradient
through the optimum, this compares sampled plans.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx
from jaxtyping import Array, Float

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.planning import Planner, PlannerConfig, reduced_goal

_BLOCKS = (9, 16)  # rows and columns of the image that the critic sees
_NEAREST = 0.3  # [m] depth below which its inverse saturates


@dataclass(frozen=True)
class PpoSettings:
    """Settings of the PPO baseline; the optimiser and the number of batches are those of every method.

    Attributes:
        samples: paths tried for each frame of a batch.
        epochs: gradient steps on a batch before new paths are tried.
        clip: largest change of a probability ratio that is still rewarded.
        deviation: [m] standard deviation of every waypoint coordinate at the start; it is learned.
        entropy: weight of the policy's entropy.
        value: weight of the critic's error.
        worst_return: returns are cut off here: single paths off the map cost thousands, and would drown all others.
    """

    samples: int = 4
    epochs: int = 4
    clip: float = 0.2
    deviation: float = 0.3
    entropy: float = 1e-3
    value: float = 0.5
    worst_return: float = -50.0

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if min(self.samples, self.epochs) < 1:
            raise InputError("PPO needs at least one sample and one epoch.")
        if not (0 < self.clip < 1 and self.deviation > 0 and self.entropy >= 0 and self.value >= 0):
            raise InputError("PPO needs a clip in (0, 1), a positive deviation and weights that are not negative.")


class Experience(NamedTuple):
    """What was tried on a batch, under the policy before the update.

    Attributes:
        actions: (samples, batch, k, 2) [m] waypoints.
        log_density: (samples, batch) of the actions.
        returns: (samples, batch) minus the cost of their paths.
        advantages: (samples, batch) returns minus the critic's values, normalised.
    """

    actions: Float[Array, "samples batch k 2"]
    log_density: Float[Array, "samples batch"]
    returns: Float[Array, "samples batch"]
    advantages: Float[Array, "samples batch"]


class PpoLosses(NamedTuple):
    """Terms of PPO's objective, unweighted.

    Attributes:
        surrogate: minus the clipped, advantage-weighted probability ratio.
        value_error: Huber loss of the critic.
        entropy: of the policy [nat].
    """

    surrogate: Float[Array, ""]
    value_error: Float[Array, ""]
    entropy: Float[Array, ""]


class Critic(nnx.Module):
    """Expected return of a frame and goal: two hidden layers on a coarse image of inverse depth and the goal."""

    def __init__(self, hidden: int, rngs: nnx.Rngs):
        self.layer1 = nnx.Linear(_BLOCKS[0] * _BLOCKS[1] + 3, hidden, rngs=rngs)
        self.layer2 = nnx.Linear(hidden, hidden, rngs=rngs)
        self.layer3 = nnx.Linear(hidden, 1, rngs=rngs)

    def __call__(self, depth: Float[Array, "batch h w"], goal: Float[Array, "batch 2"]) -> Float[Array, " batch"]:
        """Values of depth images [m] (0 = no return) and reduced goals [m]."""
        inverse = jnp.where(depth > 0, 1.0 / jnp.maximum(depth, _NEAREST), 0.0)
        coarse = jax.image.resize(inverse, (depth.shape[0], *_BLOCKS), "linear").reshape(depth.shape[0], -1)
        distance = jnp.sqrt(jnp.sum(goal**2, axis=-1, keepdims=True) + 1e-6)
        hidden = jnp.tanh(self.layer1(jnp.concatenate([coarse, goal, distance], axis=-1)))
        return self.layer3(jnp.tanh(self.layer2(hidden)))[:, 0]


class ActorCritic(nnx.Module):
    """What PPO trains: the planner, the spread of its waypoints and the critic."""

    def __init__(self, config: PlannerConfig, settings: PpoSettings, rngs: nnx.Rngs):
        self.planner = Planner(config, rngs)
        start = jnp.full((config.ipath.waypoints, 2), np.log(settings.deviation), jnp.float32)
        self.log_deviation = nnx.Param(start)
        self.critic = Critic(config.ipath.hidden, rngs)

    def value(self, depth: Float[Array, "batch h w"], goal: Float[Array, "batch 2"]) -> Float[Array, " batch"]:
        """The critic's expected returns."""
        return self.critic(depth, reduced_goal(goal, self.planner.config.ipath.goal_reach))


def log_density(
    actions: Float[Array, "*#batch k 2"], mean: Float[Array, "*#batch k 2"], log_deviation: Float[Array, "k 2"]
) -> Float[Array, "*#batch"]:
    """Logarithm of the Gaussian policy's density at waypoints [m]."""
    standard = (actions - mean) * jnp.exp(-log_deviation)
    return -jnp.sum(0.5 * standard**2 + log_deviation + 0.5 * np.log(2 * np.pi), axis=(-2, -1))


def normalised(advantages: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Advantages with mean zero and deviation one over the whole batch."""
    return (advantages - jnp.mean(advantages)) / (jnp.std(advantages) + 1e-6)


def ppo_losses(
    mean: Float[Array, "batch k 2"],
    log_deviation: Float[Array, "k 2"],
    value: Float[Array, " batch"],
    tried: Experience,
    settings: PpoSettings,
) -> PpoLosses:
    """Terms of PPO's objective for the policy and critic as they are now.

    Args:
        mean: (batch, k, 2) [m] the policy's waypoints.
        log_deviation: (k, 2) logarithm of their standard deviation [m].
        value: (batch,) the critic's.
        tried: under the policy before the update.
        settings: clip.
    """
    ratio = jnp.exp(log_density(tried.actions, mean, log_deviation) - tried.log_density)
    clipped = jnp.clip(ratio, 1.0 - settings.clip, 1.0 + settings.clip)
    surrogate = -jnp.mean(jnp.minimum(ratio * tried.advantages, clipped * tried.advantages))
    value_error = jnp.mean(optax.huber_loss(jnp.broadcast_to(value, tried.returns.shape), tried.returns))
    entropy = jnp.sum(log_deviation + 0.5 * np.log(2 * np.pi * np.e))
    return PpoLosses(surrogate, value_error, entropy)


def ppo_sum(losses: PpoLosses, settings: PpoSettings) -> Float[Array, ""]:
    """Weighted sum of the terms, to be minimised."""
    return losses.surrogate + settings.value * losses.value_error - settings.entropy * losses.entropy
