"""The whole upper-level loss on frames and goals that no planner can serve: finite loss and gradient all the same."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.data.frame_set import FrameSet, depth_to_millimetres
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.planning.split_module import split_module
from iwalker_jax.training.batches import gather_batch
from iwalker_jax.training.maps import prepare
from iwalker_jax.training.objectives import batch_losses
from iwalker_jax.training.train_step import make_planner
from tests.perception.box_scene import render

MOUNT = CameraMount()
BOX = (1.5, 2.3, -0.5, 0.9, 0.0, 1.2)
GOALS = {"behind": (-3.0, 0.2), "inside a box": (1.9, 0.2), "at the feet": (0.0, 0.0), "100 m away": (100.0, 30.0)}


def images() -> dict[str, np.ndarray]:
    """A box ahead, a wall at arm's length everywhere, and no return at all."""
    scene = render(Intrinsics(), MOUNT, [BOX, (5.0, 5.2, -6.0, 6.0, 0.0, 2.5)])
    return {"box": scene, "all blocked": np.full_like(scene, 0.2), "empty": np.zeros_like(scene)}


@pytest.fixture(scope="module")
def outcome(small_config):
    """Loss terms, counting rows and gradient for each image; the batch's four rows are the four goals."""
    depth = depth_to_millimetres(np.repeat(np.stack(list(images().values())), len(GOALS), axis=0))
    n = len(depth)
    # Three equal goals a frame (the number that the shared data has): whichever is drawn, a row's goal is its own.
    goals = np.tile(np.float32(list(GOALS.values()))[:, None], (3, 3, 1))
    mounts = np.tile(np.asarray(MOUNT.as_array()), (n, 1))
    poses, scenes = np.zeros((n, 3), np.float32), np.zeros(n, np.int32)
    frames = FrameSet(depth, mounts, goals, poses, scenes, ("made",), Intrinsics())
    data = prepare(frames, small_config.models.traversal, batch=8)
    network = split_module(make_planner(small_config))

    @jax.jit
    def evaluate(index):
        batch = gather_batch(data, index, jax.random.key(0), False, small_config.planner)

        def loss(network):
            value, (terms, counts, plan) = batch_losses(network.merge(), batch, small_config)
            return value, (terms, counts, plan)

        return batch.goal, *jax.value_and_grad(loss, has_aux=True)(network)

    return {name: evaluate(jnp.arange(4) + 4 * k) for k, name in enumerate(images())}


@pytest.mark.parametrize("name", ["box", "all blocked", "empty"])
def test_loss_and_gradient_are_finite(outcome, name):
    goal, (loss, (terms, counts, plan)), gradient = outcome[name]
    np.testing.assert_allclose(goal, np.float32(list(GOALS.values())))
    assert np.isfinite(loss)
    for term, value in terms.items():
        assert np.isfinite(value), term
    for leaf in jax.tree.leaves((plan, gradient)):
        assert np.isfinite(leaf).all()
    assert counts.shape == (4,)
    assert bool(counts.any())
    assert any(np.abs(leaf).max() > 0 for leaf in jax.tree.leaves(gradient))


def test_no_term_explodes(outcome):
    """Property: a goal 100 m away costs no more than a map's width of detours, so no batch is dominated by it."""
    for _, (loss, (terms, _, _)), _ in outcome.values():
        assert abs(float(loss)) < 1e4
        assert float(terms["regret"]) < 500.0
