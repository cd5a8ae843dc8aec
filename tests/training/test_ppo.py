"""PPO: objective and density re-derived, gradients by finite differences, returns, and training like every method."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx
from scipy.stats import norm

from iwalker_jax.errors import InputError
from iwalker_jax.planning.planner import Planner, waypoints_to_path
from iwalker_jax.training.batches import gather_batch
from iwalker_jax.training.loop import train
from iwalker_jax.training.losses import path_losses, weighted_sum
from iwalker_jax.training.objectives import explore
from iwalker_jax.training.ppo import (
    ActorCritic,
    Experience,
    PpoSettings,
    log_density,
    normalised,
    ppo_losses,
    ppo_sum,
)
from iwalker_jax.training.run_log import read_metrics
from iwalker_jax.training.train_step import make_planner, planner_from
from tests.gradients import assert_gradients_agree
from tests.training.conftest import assert_trees_equal

SETTINGS = PpoSettings()
SAMPLES, BATCH, WAYPOINTS = 3, 4, 5


def situation(seed: int = 0):
    """Mean, log deviation and values now, and what was tried under a slightly different policy; double precision."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(size=(BATCH, WAYPOINTS, 2))
    deviation = np.log(0.3) + 0.1 * rng.normal(size=(WAYPOINTS, 2))
    actions = mean + 0.3 * rng.normal(size=(SAMPLES, BATCH, WAYPOINTS, 2))
    before = norm.logpdf(actions, mean, np.exp(deviation)).sum(axis=(2, 3)) + 0.3 * rng.normal(size=(SAMPLES, BATCH))
    returns, advantages = rng.normal(size=(2, SAMPLES, BATCH))
    tried = Experience(*(jnp.asarray(x) for x in (actions, before, 3.0 * returns, advantages)))
    return jnp.asarray(mean), jnp.asarray(deviation), jnp.asarray(rng.normal(size=BATCH)), tried


def test_density_is_scipys(x64):
    """Oracle: SciPy's normal distribution, coordinate by coordinate."""
    mean, deviation, _, tried = situation()
    wanted = norm.logpdf(tried.actions, mean, np.exp(deviation)).sum(axis=(2, 3))
    np.testing.assert_allclose(log_density(tried.actions, mean, deviation), wanted, rtol=1e-10)


def test_objective_equals_a_rederivation(x64):
    """Oracle: NumPy loops over every sample, with both sides of the clip met."""
    mean, deviation, value, tried = situation()
    surrogate, error, sides = [], [], set()
    for s in range(SAMPLES):
        for b in range(BATCH):
            density = norm.logpdf(tried.actions[s, b], mean[b], np.exp(deviation)).sum()
            ratio, advantage = np.exp(density - float(tried.log_density[s, b])), float(tried.advantages[s, b])
            sides.add((advantage > 0, ratio > 1.2, ratio < 0.8))
            surrogate.append(-min(ratio * advantage, min(max(ratio, 0.8), 1.2) * advantage))
            gap = abs(float(value[b] - tried.returns[s, b]))
            error.append(0.5 * gap**2 if gap < 1 else gap - 0.5)
    losses = ppo_losses(mean, deviation, value, tried, SETTINGS)
    assert len(sides) >= 4
    entropy = sum(norm(scale=scale).entropy() for scale in np.exp(np.asarray(deviation)).ravel())
    assert float(losses.surrogate) == pytest.approx(np.mean(surrogate), rel=1e-9)
    assert float(losses.value_error) == pytest.approx(np.mean(error), rel=1e-9)
    assert float(losses.entropy) == pytest.approx(entropy, rel=1e-9)
    total = losses.surrogate + SETTINGS.value * losses.value_error - SETTINGS.entropy * losses.entropy
    assert float(ppo_sum(losses, SETTINGS)) == pytest.approx(float(total))


@pytest.mark.parametrize("seed", [0, 1])
def test_gradient_equals_finite_differences(x64, seed):
    """Oracle: central differences for mean, deviation and value."""
    mean, deviation, value, tried = situation(seed)

    def loss(mean, deviation, value):
        return ppo_sum(ppo_losses(mean, deviation, value, tried, SETTINGS), SETTINGS)[None]

    assert_gradients_agree(jax.jit(loss), mean, deviation, value)


def test_a_ratio_beyond_the_clip_earns_no_more(x64):
    """Property: where all ratios have grown past the clip on good samples, no gradient moves the mean."""
    mean, deviation, value, tried = situation()
    good = tried._replace(
        log_density=log_density(tried.actions, mean, deviation) - 1.0, advantages=jnp.ones((SAMPLES, BATCH))
    )
    gradient = jax.grad(lambda m: ppo_losses(m, deviation, value, good, SETTINGS).surrogate)(mean)
    np.testing.assert_array_equal(gradient, 0.0)


def test_advantages_are_normalised():
    values = normalised(jnp.asarray([[1.0, 2.0], [5.0, -4.0]]))
    assert float(jnp.mean(values)) == pytest.approx(0.0, abs=1e-6)
    assert float(jnp.std(values)) == pytest.approx(1.0, rel=1e-4)
    assert np.isfinite(normalised(jnp.ones((2, 2)))).all()


@pytest.fixture(scope="module")
def config(small_config):
    return dataclasses.replace(small_config, method="ppo", ppo=PpoSettings(samples=2, epochs=2))


def test_returns_are_minus_u_path_of_the_sampled_paths(config, small_data):
    """Oracle: the losses called for each path alone; a path off the map is cut off at the worst return."""
    models = config.models
    batch = gather_batch(small_data, jnp.arange(4), jax.random.key(0), True, config.planner)
    learner = ActorCritic(config.planner, config.ppo, nnx.Rngs(0))
    tried, said = jax.jit(lambda key: explore(learner, batch, key, config))(jax.random.key(1))
    weights = dataclasses.replace(config.weights, fear=0.0)
    one = jax.jit(lambda path, maps: weighted_sum(path_losses(path, jnp.zeros(()), maps, models, "stopped"), weights))
    for s, b in ((0, 0), (1, 2)):
        waypoints = learner.planner.ipath.constrained(tried.actions[s, b], batch.goal[b])
        cost = one(waypoints_to_path(waypoints[None])[0], jax.tree.map(lambda x, b=b: x[b], batch.maps))
        assert float(tried.returns[s, b]) == pytest.approx(max(-float(cost), config.ppo.worst_return), rel=1e-3)
    mean = learner.planner.plan_path(batch.depth, batch.goal, batch.mount)[1]
    assert float(said["return"]) == pytest.approx(float(jnp.mean(tried.returns)), rel=1e-5)
    spread = np.std(tried.actions - mean)
    assert 0.5 * config.ppo.deviation < spread < 2.0 * config.ppo.deviation


def test_a_resumed_run_equals_an_uninterrupted_one_bit_for_bit(config, small_data, tmp_path):
    """And PPO trains both networks, the spread and the critic, from a planner that is handed to it."""
    start = make_planner(dataclasses.replace(config, seed=7))
    whole = train(config, small_data, tmp_path / "whole", start_from=start, stop_after=3, say=lambda text: None)
    train(config, small_data, tmp_path / "parts", start_from=start, stop_after=2, say=lambda text: None)
    parts = train(config, small_data, tmp_path / "parts", stop_after=3, say=lambda text: None)
    assert_trees_equal(whole.state, parts.state)
    lines = read_metrics(tmp_path / "whole" / "metrics.jsonl")
    assert all(np.isfinite(list(line.values())).all() for line in lines)
    assert {"return", "surrogate", "value_error", "entropy", "U_path", "U_step"} <= set(lines[0])

    planner = planner_from(config, whole.state.params)
    assert isinstance(planner, Planner)
    for part in ("ipath", "istepper"):
        before, after = (jax.tree.leaves(nnx.state(getattr(p, part), nnx.Param)) for p in (start, planner))
        moved = [float(jnp.max(jnp.abs(a - b))) for a, b in zip(before, after, strict=True)]
        assert 0 < max(moved) < 0.1
    fresh = jax.tree.leaves(whole.state.params["critic"])
    assert all(np.isfinite(leaf).all() for leaf in fresh)
    assert float(jnp.max(jnp.abs(whole.state.params["log_deviation"][...] - np.log(config.ppo.deviation)))) > 0


@pytest.mark.parametrize("change", [{"samples": 0}, {"epochs": 0}, {"clip": 1.5}, {"deviation": 0.0}])
def test_impossible_settings_are_refused(change):
    with pytest.raises(InputError, match="PPO needs"):
        PpoSettings(**change)
