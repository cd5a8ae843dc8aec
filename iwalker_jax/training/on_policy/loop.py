"""The loop of on-policy training: a round of walking, a few epochs over what was seen, and so on.

Rounds share nothing but parameters, optimiser and robots, and draw by (seed, round): a run that was stopped goes on
from its checkpoint to the same parameters, bit for bit.
"""

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import nnx
from jaxtyping import Array, Float, Int

from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.planning import MemoryIPath, SplitModule, split_module
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.files import first_line, read_npz, write_npz
from iwalker_jax.runtime.locks import exclusive
from iwalker_jax.surrogate import (
    SurrogateOutcome,
    SurrogateState,
    TrueFields,
    Visit,
    make_fields,
    start_surrogate,
    surrogate_step,
)
from iwalker_jax.training.loop import run_lock
from iwalker_jax.training.on_policy.config import OnPolicyConfig
from iwalker_jax.training.on_policy.losses import ProposalReport, proposal_loss
from iwalker_jax.training.run_log import LoggerName, RunLog

_CONFIG, _ROUND = "config", "round"
_MOST_BROKEN = 10  # steps in a row without a finite gradient that are passed over
_LEAST_RATE = 0.02  # of the learning rate, at the end


class OnPolicyState(NamedTuple):
    """Everything that a run carries from round to round.

    Attributes:
        network: parameters and structure.
        optimiser: state of AdamW.
        robots: on their way, batch first.
    """

    network: SplitModule[MemoryIPath]
    optimiser: optax.OptState
    robots: SurrogateState


class OnPolicyProgress(NamedTuple):
    """How a round went.

    Attributes:
        round: that has ended, of rounds in all.
        reached, collided, timed_out: share of the walks that ended in it.
        report: of the last epoch.
        frames_per_second: of walking and learning.
    """

    round: int
    rounds: int
    reached: float
    collided: float
    timed_out: float
    report: ProposalReport
    frames_per_second: float


class OnPolicyResult(NamedTuple):
    """How a run ended.

    Attributes:
        network: as far as it was trained.
        rounds: that it was trained for; fewer than asked for if the run was stopped.
    """

    network: MemoryIPath
    rounds: int


def train_on_policy(
    config: OnPolicyConfig,
    folder: Path,
    *,
    resume: bool = True,
    checkpoint_every: int = 10,
    stop_after: int | None = None,
    loggers: Sequence[LoggerName] = (),
    on_progress: Callable[[OnPolicyProgress], None] = lambda progress: None,
    say: Callable[[str], None] = print,
) -> OnPolicyResult:
    """Train iPath with a memory; the checkpoint and metrics go to `folder`.

    Args:
        config: of the run; a resumed run must have the one it began with.
        folder: of the run.
        resume: continue from the folder's checkpoint, if there is one.
        checkpoint_every: rounds.
        stop_after: round after which to stop, as if interrupted.
        loggers: beside the metrics file.
        on_progress: hears of every round.
        say: hears the sentences a user must read.

    Raises:
        CheckpointError: if the folder's checkpoint cannot be read, or is of another configuration.
        InputError: if another process trains in the folder.
        FloatingPointError: after a round without finite losses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "checkpoint.npz"
    with exclusive(run_lock(folder), folder):
        fields = practice_scenes(config)
        state = first_state(config, fields)
        first = 0
        if resume and file.exists():
            state, first = _restored(file, config, state)
            say(f"Resuming at round {first} of {config.rounds}.")
        log = RunLog(folder, config, first, loggers, say)
        last = min(config.rounds, config.rounds if stop_after is None else stop_after)
        saved = done = first
        try:
            for number in range(first, last):
                clock = time.perf_counter()
                state, report, counts = jax.block_until_ready(run_round(config, fields, state, jnp.asarray(number)))
                progress = _progress(config, number, report, counts, time.perf_counter() - clock)
                numbers = {name: float(getattr(progress, name)) for name in ("reached", "collided", "timed_out")}
                numbers |= {name: float(value) for name, value in report._asdict().items()}
                if not np.isfinite(list(numbers.values())).all():
                    raise FloatingPointError(
                        f"Round {number} gave losses that are not finite; lower the learning rate. The checkpoint of "
                        f"round {saved} is whole."
                    )
                done = number + 1
                log.write(number, numbers | {"frames_per_second": progress.frames_per_second})
                on_progress(progress)
                if done % checkpoint_every == 0 or done == last:
                    _save(file, config, state, done)
                    saved = done
        except KeyboardInterrupt:
            say(f"Interrupted; the same command goes on from round {saved}.")
        finally:
            log.close()
    return OnPolicyResult(state.network.merge(), done)


def practice_scenes(config: OnPolicyConfig) -> TrueFields:
    """The scenes that a run walks in."""
    return make_fields(config.scenes, config.seed, config.grids)


def first_state(config: OnPolicyConfig, fields: TrueFields) -> OnPolicyState:
    """A network that knows nothing, and its robots at the start."""
    key = jax.random.key(config.seed)
    network = split_module(MemoryIPath(config.network, nnx.Rngs(config.seed)))
    robots = _many_starts(config, fields, jax.random.split(key, config.robots))
    return OnPolicyState(network, make_adam(config).init(network.params), robots)


@partial(jax.jit, static_argnums=0)
def run_round(
    config: OnPolicyConfig, fields: TrueFields, state: OnPolicyState, number: Int[Array, ""]
) -> tuple[OnPolicyState, ProposalReport, Int[Array, " outcomes"]]:
    """Walk some steps, and learn from what was seen.

    Returns:
        The state, the last epoch's mean report, and how many walks ended in each `SurrogateOutcome`.
    """
    explore, spread = boldness(config, number)
    robots, visits, counts = walk_round(config, fields, state.network, state.robots, explore)
    key = jax.random.fold_in(jax.random.key(config.seed), number)
    seen = config.robots * config.steps

    def batch_step(carry: tuple[Any, Any], rows: Int[Array, " batch"]) -> tuple[tuple[Any, Any], ProposalReport]:
        params, optimiser = carry

        def loss(params: Any) -> tuple[Array, ProposalReport]:
            network = state.network.with_params(params).merge()
            batch = jax.tree.map(lambda leaf: leaf[rows], visits)
            return proposal_loss(network, config, fields, batch, spread)

        gradient, report = jax.grad(loss, has_aux=True)(params)
        updates, optimiser = make_adam(config).update(gradient, optimiser, params)
        return (optax.apply_updates(params, updates), optimiser), report

    def epoch(carry: tuple[Any, Any], key: Array) -> tuple[tuple[Any, Any], ProposalReport]:
        order = jax.random.permutation(key, seen)[: config.batches * config.batch]
        return jax.lax.scan(batch_step, carry, order.reshape(config.batches, config.batch))

    keys = jax.random.split(key, config.epochs)
    (params, optimiser), reports = jax.lax.scan(epoch, (state.network.params, state.optimiser), keys)
    report = jax.tree.map(lambda values: jnp.mean(values[-1]), reports)
    return OnPolicyState(state.network.with_params(params), optimiser, robots), report, counts


def boldness(config: OnPolicyConfig, number: Int[Array, ""]) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """The probability of a candidate at random in a round, and the share of what all candidates learn alike."""
    share = number / config.rounds
    return config.explore * (1 - share), config.spread * jnp.maximum(1 - 3 * share, 0.1)


def walk_round(
    config: OnPolicyConfig,
    fields: TrueFields,
    network: SplitModule[MemoryIPath],
    robots: SurrogateState,
    explore: Float[Array, ""],
) -> tuple[SurrogateState, Visit, Int[Array, " outcomes"]]:
    """Some steps of all robots; who has ended starts anew.

    Returns:
        The robots, what they saw (robots and steps along one axis), and how many ended in each `SurrogateOutcome`.
    """
    planner = network.merge()

    def step(robots: SurrogateState, _: None) -> tuple[SurrogateState, tuple[Array, Visit]]:
        def one(robot: SurrogateState) -> tuple[SurrogateState, Array, Visit]:
            return surrogate_step(config.robot, config.grids, planner, fields, robot, explore)

        robots, outcome, visits = jax.vmap(one)(robots)
        fresh = _many_starts(config, fields, robots.key)
        # Where no start was found nobody has walked.
        walked = jnp.where(robots.most_steps > 0, outcome, 0)
        ended = outcome != SurrogateOutcome.RUNNING
        robots = jax.vmap(lambda ends, *states: jax.tree.map(partial(jnp.where, ends), *states))(ended, fresh, robots)
        return robots, (walked, visits)

    robots, (outcomes, visits) = jax.lax.scan(step, robots, None, length=config.steps)
    counts = jnp.bincount(outcomes.ravel(), length=len(SurrogateOutcome))
    return robots, jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:]), visits), counts


def _many_starts(config: OnPolicyConfig, fields: TrueFields, keys: Array) -> SurrogateState:
    return jax.vmap(lambda key: start_surrogate(config.robot, config.grids, fields, key))(keys)


def make_adam(config: OnPolicyConfig) -> optax.GradientTransformation:
    steps = config.rounds * config.epochs * config.batches
    rate = optax.cosine_decay_schedule(config.learning_rate, steps, _LEAST_RATE)
    adam = optax.chain(optax.clip_by_global_norm(config.clip), optax.adamw(rate, weight_decay=config.weight_decay))
    return optax.apply_if_finite(adam, _MOST_BROKEN)


def _progress(
    config: OnPolicyConfig, number: int, report: ProposalReport, counts: Array, seconds: float
) -> OnPolicyProgress:
    ended = np.asarray(counts, float)
    shares = ended / max(ended[1:].sum(), 1.0)
    return OnPolicyProgress(
        round=number + 1,
        rounds=config.rounds,
        reached=float(shares[SurrogateOutcome.REACHED]),
        collided=float(shares[SurrogateOutcome.COLLIDED]),
        timed_out=float(shares[SurrogateOutcome.TIMED_OUT]),
        report=report,
        frames_per_second=config.robots * config.steps / max(seconds, 1e-9),
    )


def _named(state: OnPolicyState) -> dict[str, Any]:
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(path): leaf for path, leaf in leaves}


def _is_key(leaf: Any) -> bool:
    return jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)


def _save(file: Path, config: OnPolicyConfig, state: OnPolicyState, number: int) -> None:
    arrays = {
        name: np.asarray(jax.random.key_data(leaf) if _is_key(leaf) else leaf) for name, leaf in _named(state).items()
    }
    arrays |= {_CONFIG: np.asarray(json.dumps(config_to_dict(config))), _ROUND: np.asarray(number)}
    try:
        write_npz(file, arrays)
    except OSError as error:
        raise CheckpointError(
            f"Cannot write the checkpoint {file}: {error.strerror}; the same command goes on from the one before."
        ) from error


def _restored(file: Path, config: OnPolicyConfig, template: OnPolicyState) -> tuple[OnPolicyState, int]:
    try:
        arrays = read_npz(file)
        made, number = str(arrays.pop(_CONFIG)), int(arrays.pop(_ROUND))
        if json.loads(made) != json.loads(json.dumps(config_to_dict(config))):
            raise CheckpointError(
                f"{file} belongs to a run with another configuration; use what it was made with, or another folder."
            )
        leaves = [_leaf(arrays[name], leaf) for name, leaf in _named(template).items()]
    except (InputError, KeyError, ValueError) as error:
        raise CheckpointError(
            f"{file} holds no training that can go on ({first_line(error)}); delete it or choose another folder."
        ) from error
    return jax.tree.unflatten(jax.tree.structure(template), leaves), number


def _leaf(array: np.ndarray, like: Array) -> Array:
    if _is_key(like):
        return jax.random.wrap_key_data(jnp.asarray(array))
    if array.shape != like.shape or array.dtype != like.dtype:
        raise ValueError(f"an array of shape {array.shape} instead of {like.shape}")
    return jnp.asarray(array)
