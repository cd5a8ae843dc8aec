"""What each method minimises on a batch: plan, lower-level optima, and the weighted sum of the losses."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwalker_jax.perception import DEFAULT_GRID, sample_smooth
from iwalker_jax.planning import Plan, Planner, next_foot, reduced_goal, waypoints_to_path
from iwalker_jax.training.baselines import heuristic_losses, heuristic_sum
from iwalker_jax.training.batches import TrainingBatch
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.losses import fear_loss, path_losses, step_losses, weighted_sum
from iwalker_jax.training.ppo import ActorCritic, Experience, log_density, normalised, ppo_losses, ppo_sum
from iwalker_jax.training.whole_body_losses import ControlledRobot, whole_body_losses


def batch_losses(
    planner: Planner, batch: TrainingBatch, config: TrainConfig, controlled: ControlledRobot | None = None
) -> tuple[Array, tuple[dict, Array, Plan]]:
    """Total loss of a batch, its terms, the rows that count, and the plan; for every method but PPO.

    U_path is a function of the path alone, so it reaches iPath only; U_step is a function of the footsteps, which
    follow from the path, so it reaches both unless `step_to_path` is off. With a controlled robot the
    whole-body losses are part of U_step.
    """
    path, waypoints, fear = planner.plan_path(batch.depth, batch.goal, batch.mount)
    path_loss, path_terms = _path_loss(path, fear, batch, config)
    joint = config.weights.step_to_path and config.method == "iwalker"
    followed = path if joint else jax.lax.stop_gradient(path)
    footsteps, step_loss, step_terms = _step_loss(planner, followed, batch, config, controlled)

    # An implicit gradient is only right at the optimum: rows that did not converge are counted and left out.
    counts = path_terms["converged"] & step_terms["converged"]
    loss = jnp.mean(jnp.where(counts, path_loss + step_loss, 0.0))
    sums = {"U_path": path_loss, "U_step": step_loss, "total": loss}
    plan = Plan(path, waypoints, fear, footsteps, next_foot(batch.state))
    return loss, (_means(path_terms | step_terms | sums), counts, plan)


def explore(
    learner: ActorCritic, batch: TrainingBatch, key: Array, config: TrainConfig
) -> tuple[Experience, dict[str, Array]]:
    """Waypoints drawn from PPO's policy, and what their paths earn: minus U_path, but for fear, which is no choice.

    Also the terms of U_path of the policy's mean, which is the planner's own path.
    """
    planner, settings = learner.planner, config.ppo
    _, mean, fear = planner.plan_path(batch.depth, batch.goal, batch.mount)
    log_deviation = learner.log_deviation[...]
    actions = mean + jnp.exp(log_deviation) * jax.random.normal(key, (settings.samples, *mean.shape))
    near_goal = reduced_goal(batch.goal, planner.config.ipath.goal_reach)

    def u_path(waypoints: Array) -> tuple[Array, dict[str, Array]]:
        paths = waypoints_to_path(planner.ipath.constrained(waypoints, near_goal))
        return _path_loss(paths, fear, batch, config)

    # A reward needs no derivative of the optimum.
    loss, terms = jax.lax.stop_gradient(jax.vmap(u_path)(jnp.concatenate([mean[None], actions])))
    returns = config.weights.fear * terms["fear"][1:] - loss[1:]
    returns = jnp.where(jnp.isfinite(returns), jnp.maximum(returns, settings.worst_return), settings.worst_return)
    advantages = normalised(returns - learner.value(batch.depth, batch.goal))
    tried = Experience(actions, log_density(actions, mean, log_deviation), returns, advantages)
    said = {name: value[0] for name, value in terms.items()} | {"U_path": loss[0], "return": returns}
    return tried, _means(said)


def policy_losses(
    learner: ActorCritic,
    batch: TrainingBatch,
    tried: Experience,
    config: TrainConfig,
    controlled: ControlledRobot | None = None,
) -> tuple[Array, tuple[dict, Array, Plan]]:
    """What `batch_losses` says, for PPO: U_path reaches iPath as a reward alone; fear and footsteps learn as ever."""
    planner, settings = learner.planner, config.ppo
    path, waypoints, fear = planner.plan_path(batch.depth, batch.goal, batch.mount)
    followed = jax.lax.stop_gradient(path)
    value = learner.value(batch.depth, batch.goal)
    policy = ppo_losses(waypoints, learner.log_deviation[...], value, tried, settings)
    clearance = jax.vmap(lambda esdf, points: sample_smooth(esdf, DEFAULT_GRID, points))(batch.maps.esdf, followed)
    fears = jax.vmap(lambda logit, row: fear_loss(logit, row, config.models))(fear, clearance)
    footsteps, step_loss, step_terms = _step_loss(planner, followed, batch, config, controlled)
    counts = step_terms["converged"]
    taught = jnp.mean(jnp.where(counts, config.weights.fear * fears + step_loss, 0.0))
    loss = ppo_sum(policy, settings) + taught
    sums = {"U_step": step_loss, "total": loss}
    terms = _means(policy._asdict() | step_terms | sums)
    return loss, (terms, counts, Plan(path, waypoints, fear, footsteps, next_foot(batch.state)))


def _path_loss(path: Array, fear: Array, batch: TrainingBatch, config: TrainConfig) -> tuple[Array, dict[str, Array]]:
    """Each row's path loss and its terms, by the method."""
    if config.method in ("iplanner", "finetuned"):
        heuristic = jax.vmap(heuristic_losses)(path, fear, batch.goal, batch.maps)
        loss, terms = jax.vmap(heuristic_sum)(heuristic), heuristic._asdict()
        if config.method == "iplanner":
            return loss, terms
    bilevel = jax.vmap(lambda p, f, m: path_losses(p, f, m, config.models, config.gradient))(path, fear, batch.maps)
    if config.method == "finetuned":
        loss = loss + config.weights.tracking * bilevel.tracking
        return loss, terms | {"tracking": bilevel.tracking, "converged": bilevel.converged}
    return jax.vmap(lambda row: weighted_sum(row, config.weights))(bilevel), bilevel._asdict()


def _step_loss(
    planner: Planner, path: Array, batch: TrainingBatch, config: TrainConfig, controlled: ControlledRobot | None
) -> tuple[Array, Array, dict[str, Array]]:
    """Footsteps along a path, each row's U_step and its terms."""
    footsteps = planner.istepper(path, batch.state)
    terms = jax.vmap(lambda s, p, x, m: step_losses(s, p, x, m, config.planner, config.models, config.gradient))(
        footsteps, path, batch.state, batch.maps
    )
    loss = jax.vmap(lambda row: weighted_sum(row, config.weights))(terms)
    if controlled is None:
        return footsteps, loss, terms._asdict()
    width = config.planner.steps.width
    whole_body = jax.vmap(lambda s, x: whole_body_losses(controlled, s, x, width))(footsteps, batch.state)
    loss = loss + jax.vmap(lambda row: weighted_sum(row, config.weights))(whole_body)
    return footsteps, loss, terms._asdict() | whole_body._asdict()


def _means(terms: dict[str, Any]) -> dict[str, Array]:
    return {name: jnp.mean(value) for name, value in terms.items() if name != "converged"}
