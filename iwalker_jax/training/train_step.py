"""One training step: gather, plan, lower-level optima, losses, one backward pass, Adam; data-parallel over devices."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from flax import nnx
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.planning.planner import Plan, Planner
from iwalker_jax.training.baselines import HeuristicLosses, heuristic_losses, heuristic_sum
from iwalker_jax.training.batches import Batch, gather_batch
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.losses import PathLosses, path_losses, step_losses, weighted_sum
from iwalker_jax.training.maps import TrainingData


class TrainState(NamedTuple):
    """Everything that a checkpoint must hold for a resumed run to equal an uninterrupted one.

    Attributes:
        params: the planner's parameters (an nnx state).
        opt_state: optimiser state.
        key: raw random key of the run; every step folds its number into it.
        step: () steps taken.
    """

    params: Any
    opt_state: Any
    key: Array
    step: Int[Array, ""]


class StepReport(NamedTuple):
    """What a step says of itself.

    Attributes:
        losses: every unweighted term's mean, the two weighted sums and their total.
        gradient_norm: () before clipping.
        converged: () share of rows whose two lower-level solves converged; the others carried no gradient.
        finite: () whether loss and gradient were finite; if not, the update was left out.
    """

    losses: dict[str, Float[Array, ""]]
    gradient_norm: Float[Array, ""]
    converged: Float[Array, ""]
    finite: Bool[Array, ""]


def make_planner(config: TrainConfig) -> Planner:
    """A freshly initialised planner."""
    return Planner(config.planner, nnx.Rngs(config.seed))


def make_optimiser(config: TrainConfig, total_steps: int) -> optax.GradientTransformationExtraArgs:
    """Adam with gradient clipping, linear warm-up and cosine decay; `update` takes a known global `norm`."""
    schedule = optax.warmup_cosine_decay_schedule(
        0.1 * config.learning_rate,
        config.learning_rate,
        min(100, max(1, total_steps // 10)),
        max(2, total_steps),  # the schedule needs a step after its warm-up, even in a run of one
        config.final_learning_rate * config.learning_rate,
    )

    def clipped(gradient: Any, state: Any, params: Any = None, *, norm: Array | None = None, **_: Any) -> Any:
        # One factor for all, fused into Adam; optax's own clipping writes a second, divided gradient first.
        norm = optax.global_norm(gradient) if norm is None else norm
        scale = jnp.where(norm < config.clip, 1.0, config.clip / norm)
        return jax.tree.map(lambda leaf: scale * leaf, gradient), state

    clip = optax.GradientTransformationExtraArgs(lambda params: optax.EmptyState(), clipped)
    return optax.chain(clip, optax.adam(schedule))


def initial_state(config: TrainConfig, optimiser: optax.GradientTransformation) -> TrainState:
    """Train state of step 0."""
    params = nnx.state(make_planner(config), nnx.Param)
    key = jax.random.key_data(jax.random.key(config.seed))
    return TrainState(params, optimiser.init(params), key, jnp.zeros((), jnp.int32))


def planner_from(config: TrainConfig, params: Any) -> Planner:
    """The planner with the given parameters."""
    return nnx.merge(planner_graph(config), params)


def planner_graph(config: TrainConfig) -> nnx.GraphDef:
    """Structure of the planner without its arrays."""
    return nnx.split(nnx.eval_shape(lambda: make_planner(config)), nnx.Param)[0]


def batch_losses(planner: Planner, batch: Batch, config: TrainConfig) -> tuple[Array, tuple[dict, Array, Plan]]:
    """Total loss of a batch, its terms, the rows that count, and the plan.

    U_path is a function of the path alone, so it reaches iPath only; U_step is a function of the footsteps, which
    follow from the path, so it reaches both unless `step_to_path` is off.
    """
    weights, models = config.weights, config.models
    path_terms: PathLosses | HeuristicLosses
    path, waypoints, fear = planner.plan_path(batch.depth, batch.goal, batch.mount)
    if config.method == "iplanner":
        path_terms = jax.vmap(heuristic_losses)(path, fear, batch.goal, batch.maps)
        path_loss = jax.vmap(heuristic_sum)(path_terms)
    else:
        path_terms = jax.vmap(lambda p, f, m: path_losses(p, f, m, models, config.gradient))(path, fear, batch.maps)
        path_loss = jax.vmap(lambda terms: weighted_sum(terms, weights))(path_terms)
    joint = weights.step_to_path and config.method == "iwalker"
    followed = path if joint else jax.lax.stop_gradient(path)
    footsteps = planner.istepper(followed, batch.state)
    step_terms = jax.vmap(lambda s, p, x, m: step_losses(s, p, x, m, models, config.gradient))(
        footsteps, followed, batch.state, batch.maps
    )
    step_loss = jax.vmap(lambda terms: weighted_sum(terms, weights))(step_terms)

    # An implicit gradient is only right at the optimum: rows that did not converge are counted and left out.
    counts = path_terms.converged & step_terms.converged
    loss = jnp.mean(jnp.where(counts, path_loss + step_loss, 0.0))
    terms = {name: jnp.mean(value) for name, value in (path_terms._asdict() | step_terms._asdict()).items()}
    terms.pop("converged")
    terms |= {"U_path": jnp.mean(path_loss), "U_step": jnp.mean(step_loss), "total": loss}
    return loss, (terms, counts, Plan(path, waypoints, fear, footsteps))


def make_train_step(
    config: TrainConfig, optimiser: optax.GradientTransformationExtraArgs, mesh: Mesh | None = None
) -> Callable[[TrainState, TrainingData, Array], tuple[TrainState, StepReport]]:
    """The jitted step (state, data, frame indices) -> (state, report).

    Args:
        config: of the run.
        optimiser: from `make_optimiser`.
        mesh: one-axis device mesh named "batch"; the frame indices are split over it, everything else is replicated.
            None runs on the default device.

    Raises:
        InputError: if the batch cannot be split evenly over the mesh.
    """
    if mesh is not None and config.batch_size % mesh.size:
        raise InputError(
            f"A batch of {config.batch_size} cannot be split over {mesh.size} devices; make it a multiple."
        )
    graph = planner_graph(config)

    def step(state: TrainState, data: TrainingData, index: Array) -> tuple[TrainState, StepReport]:
        key = jax.random.fold_in(jax.random.wrap_key_data(state.key), state.step)
        batch = gather_batch(data, index, key, config.mirror, config.models.steps, config.models.hlip)
        if mesh is not None:
            batch = jax.lax.with_sharding_constraint(batch, NamedSharding(mesh, PartitionSpec("batch")))

        def loss(params: Any) -> tuple[Array, tuple[dict, Array, Plan]]:
            return batch_losses(nnx.merge(graph, params), batch, config)

        (total, (terms, counts, _)), gradient = jax.value_and_grad(loss, has_aux=True)(state.params)
        norm = optax.global_norm(gradient)
        finite = jnp.isfinite(total) & jnp.isfinite(norm)

        def update(params: Any, opt_state: Any) -> tuple[Any, Any]:
            updates, opt_state = optimiser.update(gradient, opt_state, params, norm=norm)
            return optax.apply_updates(params, updates), opt_state

        # A bad batch must not poison the parameters: leave them and the optimiser as they were. A branch updates in
        # place; selecting between the old and the new values would pass over all of them a second time.
        params, opt_state = jax.lax.cond(finite, update, lambda *unchanged: unchanged, state.params, state.opt_state)
        report = StepReport(terms, norm, jnp.mean(counts.astype(jnp.float32)), finite)
        return TrainState(params, opt_state, state.key, state.step + 1), report

    if mesh is None:
        return jax.jit(step, donate_argnums=0)
    everywhere = NamedSharding(mesh, PartitionSpec())
    split = NamedSharding(mesh, PartitionSpec("batch"))
    return jax.jit(step, donate_argnums=0, in_shardings=(everywhere, everywhere, split), out_shardings=everywhere)
