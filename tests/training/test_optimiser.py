"""The optimiser: its clipping fused into Adam equals optax's own, whoever computes the norm."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.train_step import make_optimiser


@pytest.mark.parametrize("size", [0.1, 100.0])
@pytest.mark.parametrize("known_norm", [False, True])
def test_clipping_equals_optax(size, known_norm):
    """Oracle: `optax.clip_by_global_norm` before `optax.adam`, below and above the largest norm, over three steps."""
    config = TrainConfig(clip=10.0, learning_rate=1e-3, final_learning_rate=0.02)
    schedule = optax.warmup_cosine_decay_schedule(1e-4, 1e-3, 10, 100, 2e-5)
    ours, oracle = make_optimiser(config, 100), optax.chain(optax.clip_by_global_norm(10.0), optax.adam(schedule))
    params = {"a": jnp.ones((3, 4)), "b": jnp.ones(5)}
    state, expected_state = ours.init(params), oracle.init(params)
    for key in jax.random.split(jax.random.key(0), 3):
        gradient = jax.tree.map(lambda leaf, k=key: size * jax.random.normal(k, leaf.shape), params)
        known = {"norm": optax.global_norm(gradient)} if known_norm else {}
        updates, state = ours.update(gradient, state, params, **known)
        expected, expected_state = oracle.update(gradient, expected_state, params)
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), updates, expected)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-5), state, expected_state)
