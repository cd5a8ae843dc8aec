"""What each method minimises: fine-tuning adds the tracking term to the heuristics, and no baseline sees U_step."""

import dataclasses

import jax
import jax.numpy as jnp
import pytest

from iwalker_jax.planning.split_module import split_module
from iwalker_jax.training.batches import gather_batch
from iwalker_jax.training.objectives import batch_losses
from iwalker_jax.training.train_step import make_planner


@pytest.fixture(scope="module")
def outcome(small_config, small_data):
    """Terms of every method on one batch and planner, and U_step's gradient norms for iPath and iStepper."""
    batch = gather_batch(small_data, jnp.arange(4), jax.random.key(0), True, small_config.planner)
    network = split_module(make_planner(small_config))

    def terms(network, method):
        config = dataclasses.replace(small_config, method=method)
        _, (values, _, _) = batch_losses(network.merge(), batch, config)
        return values["U_step"], values

    def norm(tree):
        return float(sum(jnp.sum(leaf**2) for leaf in jax.tree.leaves(tree)))

    made = {}
    for method in ("iwalker", "iplanner", "finetuned"):
        gradient, values = jax.jit(jax.grad(lambda network, m=method: terms(network, m), has_aux=True))(network)
        made[method] = values, norm(gradient.params["ipath"]), norm(gradient.params["istepper"])
    return made


def test_finetuning_adds_the_tracking_term_to_the_heuristics(outcome, small_config):
    """Oracle: the sum of what the two other methods report for the same paths."""
    tracking = outcome["iwalker"][0]["tracking"]
    wanted = outcome["iplanner"][0]["U_path"] + small_config.weights.tracking * tracking
    assert float(outcome["finetuned"][0]["tracking"]) == pytest.approx(float(tracking), rel=1e-4)
    assert float(outcome["finetuned"][0]["U_path"]) == pytest.approx(float(wanted), rel=1e-4)
    assert {"obstacle", "motion", "goal"} <= set(outcome["finetuned"][0])


def test_no_baseline_learns_its_path_from_u_step(outcome):
    for method in ("iplanner", "finetuned"):
        _, ipath, istepper = outcome[method]
        assert ipath == 0
        assert istepper > 0
    assert outcome["iwalker"][1] > 0
