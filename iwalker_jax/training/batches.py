"""Batches: which frames a step sees, and how they are gathered, mirrored and given a goal and a robot state."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from iwalker_jax.data.frame_set import DEPTH_UNIT
from iwalker_jax.planning import PlannerConfig, RobotState, sample_robot_state
from iwalker_jax.training.maps import FrameMaps, TrainingData


class TrainingBatch(NamedTuple):
    """What one training step sees; every field has a leading batch axis."""

    depth: Float[Array, "batch height width"]
    goal: Float[Array, "batch 2"]
    mount: Float[Array, "batch 5"]
    state: RobotState
    maps: FrameMaps


def frame_order(seed: int, frames: int, batch_size: int, step: int) -> np.ndarray:
    """Indices of the frames of one step: a fresh permutation every epoch, a function of seed and step alone.

    Being stateless is what lets a resumed run see exactly the frames that an uninterrupted one would have seen.
    """
    per_epoch = max(1, frames // batch_size)
    epoch, position = divmod(step, per_epoch)
    order = np.random.default_rng([seed, epoch]).permutation(frames)
    return np.resize(order, max(frames, batch_size))[position * batch_size : (position + 1) * batch_size]


def gather_batch(
    data: TrainingData,
    index: Int[Array, " batch"],
    key: Array,
    mirror: bool,
    planner: PlannerConfig,
) -> TrainingBatch:
    """Frames `index`, each with a random goal (the route's end every third time) and robot state, perhaps mirrored.

    Pure; the random numbers of a row depend on its place in the batch and the key alone.
    """

    def one(i: Array, row_key: Array) -> TrainingBatch:
        k_end, k_goal, k_mirror, k_state = jax.random.split(row_key, 4)
        count = data.goals.shape[1]
        chosen = jnp.where(jax.random.uniform(k_end) < 1 / 3, 0, jax.random.randint(k_goal, (), 0, count))
        depth = data.depth[i].astype(jnp.float32) * DEPTH_UNIT
        goal = data.goals[i, chosen]
        maps = FrameMaps(
            *(field.astype(jnp.float32) for field in (
                data.esdf[i], data.unknown[i], data.to_go[i, chosen], data.routes[i, chosen], data.published[i]
            ))
        )  # fmt: skip
        # Both versions of the image exist only inside the fused selection, never as arrays.
        flip = jax.random.bernoulli(k_mirror) if mirror else jnp.asarray(False)
        depth = jnp.where(flip, depth[:, ::-1], depth)
        goal = jnp.where(flip, goal * jnp.asarray([1.0, -1.0]), goal)
        # Roll and lateral offset change sign in the mirror.
        mount = jnp.where(flip, data.mounts[i] * jnp.asarray([1.0, 1.0, -1.0, 1.0, -1.0]), data.mounts[i])
        maps = jax.tree.map(lambda field, other: jnp.where(flip, other, field), maps, maps.mirrored())
        # The sampled states are symmetric in left and right already.
        return TrainingBatch(depth, goal, mount, sample_robot_state(k_state, planner.steps, planner.hlip), maps)

    # The keys come from the row's number, so that a batch is the same however it is spread over devices.
    keys = jax.vmap(lambda row: jax.random.fold_in(key, row))(jnp.arange(index.shape[0]))
    return jax.vmap(one)(index, keys)
