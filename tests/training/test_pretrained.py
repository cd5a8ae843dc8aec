import jax
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import CheckpointError
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.pretrained import load_planner, save_planner
from iwalker_jax.training.train_step import make_planner


def test_a_planner_survives_its_file_to_half_precision(tmp_path):
    """Oracle: NumPy's float16 rounding of every parameter."""
    config = TrainConfig(seed=3)
    planner = make_planner(config)
    save_planner(tmp_path / "planner.npz", planner, config)
    loaded, read = load_planner(tmp_path / "planner.npz")
    assert read == config
    pairs = zip(
        jax.tree.leaves(nnx.state(planner, nnx.Param)), jax.tree.leaves(nnx.state(loaded, nnx.Param)), strict=True
    )
    for given, kept in pairs:
        np.testing.assert_array_equal(np.asarray(given).astype(np.float16).astype(np.float32), np.asarray(kept))


@pytest.mark.parametrize("content", [b"", b"not a planner", None])
def test_a_damaged_file_is_one_sentence(tmp_path, content):
    file = tmp_path / "planner.npz"
    if content is None:
        np.savez(file, config=np.asarray("{}"))
    else:
        file.write_bytes(content)
    with pytest.raises(CheckpointError, match="holds no planner"):
        load_planner(file)
