"""Files that replay a robot whose state turned non-finite, tick by tick.

`iwalker-walk` writes one as `nan_dump.npz` when that happens. With the walker built as the command built
it (`default_walker(sensors)`), `load_dump(file, walker)` gives the robot's conditions, plan and start state and its
last ticks, and `retrace` or `walk_tick` walks them again.
"""

from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.control import FootstepPlan
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import read_npz, write_npz
from iwalker_jax.walking.batch import BrokenRow
from iwalker_jax.walking.rollout import Conditions, Walker, WalkState, start_walk, walk_tick

KEPT_TICKS = 100
"""Last ticks whose states a dump holds."""


class TickStates(NamedTuple):
    """States at the beginning of ticks and the torques then.

    Attributes:
        tick: (n,) index from the dump's start state.
        qpos: (n, nq); qvel: (n, nv); torques: (n, nu) [N m], in size.
    """

    tick: np.ndarray
    qpos: Float[np.ndarray, "n nq"]
    qvel: Float[np.ndarray, "n nv"]
    torques: Float[np.ndarray, "n nu"]


@partial(jax.jit, static_argnames="ticks")
def _trace(walker: Walker, conditions: Conditions, plan: FootstepPlan, state: WalkState, ticks: int) -> tuple:
    """(ticks, ...) states, torques, and whether the robot was frozen in the tick."""

    def tick(state: WalkState, _: None) -> tuple[WalkState, tuple[Array, ...]]:
        after, sample = walk_tick(walker, conditions, plan, state)
        return after, (state.physics.qpos, state.physics.qvel, sample.torques, after.fallen)

    return jax.lax.scan(tick, state, None, length=ticks)[1]


def retrace(walker: Walker, broken: BrokenRow) -> TickStates:
    """The last states up to the tick that broke, walked again from the row's start state.

    A robot walked alone is another program than a batch: the states agree with the batch's up to rounding.
    """
    traced = _trace(walker, broken.conditions, broken.plan, broken.state, broken.ticks)
    qpos, qvel, torques, frozen = (np.asarray(part) for part in traced)
    end = int(np.argmax(frozen)) + 1 if frozen.any() else broken.ticks
    kept = np.arange(max(end - KEPT_TICKS, 0), end)
    return TickStates(kept, qpos[kept], qvel[kept], torques[kept])


def save_dump(file: Path, walker: Walker, broken: BrokenRow) -> TickStates:
    """Write an npz file of conditions, plan, start state and the last states, and return these.

    Raises:
        InputError: a file that cannot be written.
    """
    states = retrace(walker, broken)
    arrays = {"row": np.asarray(broken.row), "ticks": np.asarray(broken.ticks)}
    for name in ("conditions", "plan", "state"):
        leaves = jax.tree.leaves(getattr(broken, name))
        arrays |= {f"{name}_{k}": np.asarray(_plain(leaf)) for k, leaf in enumerate(leaves)}
    try:
        write_npz(file, arrays | states._asdict())
    except OSError as error:
        raise InputError(f"The dump {file} cannot be written ({error.strerror}); choose another place.") from error
    return states


def load_dump(file: Path, walker: Walker) -> tuple[BrokenRow, TickStates]:
    """A dump's row and last states; `retrace` then walks them again.

    Args:
        walker: built with the same options as the one that broke.

    Raises:
        InputError: no such dump, or one of another kind of walker.
    """
    try:
        arrays = read_npz(file)
        states = TickStates(*(arrays[name] for name in TickStates._fields))
        fields = [int(name.removeprefix("conditions_")) for name in arrays if name.startswith("conditions_")]
        conditions = Conditions(*(jnp.asarray(arrays[f"conditions_{k}"]) for k in range(len(fields))))
        conditions = conditions._replace(key=jax.random.wrap_key_data(conditions.key))
        plan = FootstepPlan(*(jnp.asarray(arrays[f"plan_{k}"]) for k in range(len(FootstepPlan._fields))))
        shapes, structure = jax.tree.flatten(jax.eval_shape(start_walk, walker, conditions))
        leaves = [_restored(arrays[f"state_{k}"], shape) for k, shape in enumerate(shapes)]
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"{file} is no dump of such a walk ({error}); use the options it was made with.") from error
    state = jax.tree.unflatten(structure, leaves)
    return BrokenRow(int(arrays["row"]), conditions, plan, state, int(arrays["ticks"])), states


def _plain(leaf: Array) -> Array:
    return jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf


def _restored(array: np.ndarray, shape: Any) -> Array:
    key = jnp.issubdtype(shape.dtype, jax.dtypes.prng_key)
    leaf = jax.random.wrap_key_data(jnp.asarray(array)) if key else jnp.asarray(array)
    if leaf.shape != shape.shape:
        raise ValueError(f"a state of shape {leaf.shape} instead of {shape.shape}")
    return leaf
