"""One of several processes that train and walk together: python -m tests.training.working_together FOLDER."""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.evaluation.episodes.study import run_episode_study
from iwalker_jax.runtime.processes import ProcessGroup, exit_process, is_first, join_group
from iwalker_jax.training.loop import TrainResult, batch_mesh, train
from iwalker_jax.training.maps import TrainingData
from tests.evaluation.episode_records import StubProgram
from tests.evaluation.episodes.test_study import SETTINGS
from tests.training.conftest import SMALL

BEGUN, ENDED = 1, 3
"""Steps that a run has made before the processes go on with it, and when they end."""


def save_data(file: Path, data: TrainingData) -> None:
    """Data as the processes read it."""
    np.savez(file, allow_pickle=False, **{name: np.asarray(value) for name, value in data._asdict().items()})


def train_until(step: int, data: TrainingData, folder: Path) -> TrainResult:
    """Train, or go on training, on all devices of all processes."""
    return train(SMALL, data, folder, mesh=batch_mesh(), stop_after=step, say=lambda sentence: None)


def main(folder: Path) -> int:
    """Go on with a run and with a study; the environment says which process this is."""
    join_group(ProcessGroup())
    assert jax.process_count() == jax.device_count() == 2
    with np.load(folder / "data.npz") as stored:
        data = TrainingData(**{name: stored[name] for name in TrainingData._fields})
    result = train_until(ENDED, data, folder / f"run{jax.process_index()}")
    study = run_episode_study(SETTINGS, lambda policy, width, images: StubProgram(images), folder / "study", None)
    if is_first():
        assert len(study.groups) == 4
        assert int(jnp.add(result.state.step, 1)) == ENDED + 1  # computed alone
    return 0


if __name__ == "__main__":
    exit_process(main(Path(sys.argv[1])))
