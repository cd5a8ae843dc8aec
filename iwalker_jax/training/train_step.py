"""One training step: gather, losses of the method, backward pass, Adam; data-parallel over devices."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax
from flax import nnx
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError
from iwalker_jax.planning import Planner, SplitModule, split_module
from iwalker_jax.training.batches import TrainingBatch, gather_batch
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.maps import TrainingData
from iwalker_jax.training.objectives import batch_losses, explore, policy_losses
from iwalker_jax.training.ppo import ActorCritic, Experience
from iwalker_jax.training.whole_body_losses import ControlledRobot, load_controlled_robot


class TrainState(NamedTuple):
    """Everything that a checkpoint must hold for a resumed run to equal an uninterrupted one.

    Attributes:
        params: of what is trained (an nnx state): the planner, for PPO with its spread and critic.
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
    """Adam with gradient clipping, linear warm-up and cosine decay; `update` takes a known global `norm`.

    Without warm-up, decay and clipping it is plain Adam.
    """
    adam = optax.adam(_learning_rate(config, total_steps * config.updates_per_step))
    if config.clip is None:
        return optax.chain(adam)
    largest = config.clip

    def clipped(gradient: Any, state: Any, params: Any = None, *, norm: Array | None = None, **_: Any) -> Any:
        # One factor for all, fused into Adam; optax's own clipping writes a second, divided gradient first.
        norm = optax.global_norm(gradient) if norm is None else norm
        scale = jnp.where(norm < largest, 1.0, largest / norm)
        return jax.tree.map(lambda leaf: scale * leaf, gradient), state

    clip = optax.GradientTransformationExtraArgs(lambda params: optax.EmptyState(), clipped)
    return optax.chain(clip, adam)


def _learning_rate(config: TrainConfig, updates: int) -> optax.Schedule:
    """Learning rate by update."""
    if config.warm_up == 0:
        return optax.cosine_decay_schedule(config.learning_rate, max(1, updates), config.final_learning_rate)
    return optax.warmup_cosine_decay_schedule(
        0.1 * config.learning_rate,
        config.learning_rate,
        min(config.warm_up, max(1, updates // 10)),
        max(2, updates),  # the schedule needs a step after its warm-up, even in a run of one
        config.final_learning_rate * config.learning_rate,
    )


def initial_state(config: TrainConfig, optimiser: optax.GradientTransformation) -> TrainState:
    """Train state of step 0."""
    params = nnx.state(_make_learner(config), nnx.Param)
    key = jax.random.key_data(jax.random.key(config.seed))
    return TrainState(params, optimiser.init(params), key, jnp.zeros((), jnp.int32))


def with_planner(config: TrainConfig, params: Any, planner: Planner) -> Any:
    """Parameters of what is trained, with the given planner's in place of its own."""
    learner = _learner_structure(config).with_params(params).merge()
    if not isinstance(learner, ActorCritic):
        return nnx.state(planner, nnx.Param)
    learner.planner = planner
    return nnx.state(learner, nnx.Param)


def planner_from(config: TrainConfig, params: Any) -> Planner:
    """The planner with the given parameters."""
    learner = _learner_structure(config).with_params(params).merge()
    return learner.planner if isinstance(learner, ActorCritic) else learner


def planner_structure(config: TrainConfig) -> SplitModule[Planner]:
    """The planner with shapes in place of its arrays."""
    return split_module(nnx.eval_shape(lambda: make_planner(config)))


def _make_learner(config: TrainConfig) -> Planner | ActorCritic:
    if config.method == "ppo":
        return ActorCritic(config.planner, config.ppo, nnx.Rngs(config.seed))
    return make_planner(config)


def _learner_structure(config: TrainConfig) -> SplitModule:
    """What is trained, with shapes in place of its arrays."""
    return split_module(nnx.eval_shape(lambda: _make_learner(config)))


TrainStep = Callable[[TrainState, TrainingData, Array], tuple[TrainState, StepReport]]
"""A step: (state, data, frame indices) -> (state, report)."""


def make_train_step(
    config: TrainConfig, optimiser: optax.GradientTransformationExtraArgs, mesh: Mesh | None = None
) -> TrainStep:
    """The jitted step; it donates the state that it is given.

    Args:
        config: of the run.
        optimiser: from `make_optimiser`.
        mesh: one-axis device mesh named "batch"; the frame indices are split over it, everything else is replicated.
            None runs on the default device.

    Raises:
        InputError: if the batch cannot be split evenly over the mesh.
    """
    check_batch_split(config, mesh)
    make = _ppo_step if config.method == "ppo" else _gradient_step
    return make(config, optimiser, mesh)


def check_batch_split(config: TrainConfig, mesh: Mesh | None) -> None:
    """Require a batch that the devices of a mesh share evenly.

    Raises:
        InputError: with both numbers.
    """
    if mesh is not None and config.batch_size % mesh.size:
        raise InputError(
            f"A batch of {config.batch_size} cannot be split over {mesh.size} devices; make it a multiple."
        )


def _gradient_step(
    config: TrainConfig, optimiser: optax.GradientTransformationExtraArgs, mesh: Mesh | None
) -> TrainStep:
    learner, controlled = _learner_structure(config), _controlled_robot(config)

    def step(state: TrainState, data: TrainingData, index: Array) -> tuple[TrainState, StepReport]:
        batch = _batch(state, data, index, config, mesh)

        def losses(params: Any) -> tuple:
            return batch_losses(learner.with_params(params).merge(), batch, config, controlled)

        params, opt_state, report = _descend(state, losses, optimiser)
        return TrainState(params, opt_state, state.key, state.step + 1), report

    return jax.jit(step, donate_argnums=0, **_placement(mesh))


def _ppo_step(config: TrainConfig, optimiser: optax.GradientTransformationExtraArgs, mesh: Mesh | None) -> TrainStep:
    """Two programs, one that tries paths and one for each of the epochs: a loop within one is slower on CPUs."""
    learner, controlled = _learner_structure(config), _controlled_robot(config)

    def attempt(
        state: TrainState, data: TrainingData, index: Array
    ) -> tuple[TrainingBatch, Experience, dict[str, Array]]:
        batch = _batch(state, data, index, config, mesh)
        # A number beyond those of the rows, which have taken theirs from the same key.
        key = jax.random.fold_in(_step_key(state), config.batch_size)
        return batch, *explore(learner.with_params(state.params).merge(), batch, key, config)

    def improve(state: TrainState, batch: TrainingBatch, tried: Experience) -> tuple[TrainState, StepReport]:
        def losses(params: Any) -> tuple:
            return policy_losses(learner.with_params(params).merge(), batch, tried, config, controlled)

        params, opt_state, report = _descend(state, losses, optimiser)
        return TrainState(params, opt_state, state.key, state.step), report

    attempt_jit = jax.jit(attempt, **_placement(mesh, outputs=False))
    improve_jit = jax.jit(improve, donate_argnums=0, **_placement(mesh, inputs=False))

    def step(state: TrainState, data: TrainingData, index: Array) -> tuple[TrainState, StepReport]:
        batch, tried, said = attempt_jit(state, data, index)
        finite = jnp.asarray(True)
        for _ in range(config.ppo.epochs):
            state, report = improve_jit(state, batch, tried)
            finite &= report.finite
        return state._replace(step=state.step + 1), report._replace(losses=said | report.losses, finite=finite)

    return step


def _controlled_robot(config: TrainConfig) -> ControlledRobot | None:
    return load_controlled_robot(config.planner) if config.weights.uses_whole_body else None


def _step_key(state: TrainState) -> Array:
    return jax.random.fold_in(jax.random.wrap_key_data(state.key), state.step)


def _batch(
    state: TrainState, data: TrainingData, index: Array, config: TrainConfig, mesh: Mesh | None
) -> TrainingBatch:
    batch = gather_batch(data, index, _step_key(state), config.mirror, config.planner)
    if mesh is None:
        return batch
    return jax.lax.with_sharding_constraint(batch, NamedSharding(mesh, PartitionSpec("batch")))


def _placement(mesh: Mesh | None, inputs: bool = True, outputs: bool = True) -> dict[str, Any]:
    """Keywords of `jax.jit` that replicate state, data and results and split the frame indices over the mesh."""
    if mesh is None:
        return {}
    everywhere, split = NamedSharding(mesh, PartitionSpec()), NamedSharding(mesh, PartitionSpec("batch"))
    placed = {"in_shardings": (everywhere, everywhere, split)} if inputs else {}
    return placed | ({"out_shardings": everywhere} if outputs else {})


def _descend(
    state: TrainState, losses: Callable, optimiser: optax.GradientTransformationExtraArgs
) -> tuple[Any, Any, StepReport]:
    """Parameters and optimiser state after one update, and the report."""
    (total, (terms, counts, _)), gradient = jax.value_and_grad(losses, has_aux=True)(state.params)
    norm = optax.global_norm(gradient)
    finite = jnp.isfinite(total) & jnp.isfinite(norm)

    def update(params: Any, opt_state: Any) -> tuple[Any, Any]:
        updates, new = optimiser.update(gradient, opt_state, params, norm=norm)
        # The schedule's numbers are double where JAX is set so; the networks and what they remember stay single.
        return optax.apply_updates(params, updates), jax.tree.map(lambda x, old: x.astype(old.dtype), new, opt_state)

    # A bad batch must not poison the parameters: leave them and the optimiser as they were. A branch updates in
    # place; selecting between the old and the new values would pass over all of them a second time.
    params, opt_state = jax.lax.cond(finite, update, lambda *unchanged: unchanged, state.params, state.opt_state)
    return params, opt_state, StepReport(terms, norm, jnp.mean(counts.astype(jnp.float32)), finite)
