"""Two processes that train and walk together, as one does by itself; skipped where CPUs have no collectives."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from iwalker_jax.evaluation.episodes.log import load_episodes, load_logs, log_file
from iwalker_jax.evaluation.episodes.study import run_episode_study
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.run_log import read_metrics
from tests.evaluation.episode_records import StubProgram
from tests.evaluation.episodes.test_study import SETTINGS
from tests.runtime.ports import free_port
from tests.training.working_together import BEGUN, ENDED, save_data, train_until


@pytest.fixture(scope="module")
def whole_study(tmp_path_factory):
    """The study as one process walks it."""
    return run_episode_study(
        SETTINGS, lambda policy, width, images: StubProgram(images), tmp_path_factory.mktemp("one"), None
    )


@pytest.fixture(scope="module")
def together(small_data, tmp_path_factory):
    """Folder in which two processes, with one device each, went on with a run and a study that one had begun."""
    folder = tmp_path_factory.mktemp("two")
    save_data(folder / "data.npz", small_data)
    train_until(BEGUN, small_data, folder / "run0")
    shutil.copytree(folder / "run0", folder / "one")

    def stops(policy, width, images):
        if policy == "classical":
            raise KeyboardInterrupt
        return StubProgram(images)

    with pytest.raises(KeyboardInterrupt):
        run_episode_study(SETTINGS, stops, folder / "study", None)
    environment = os.environ | {
        "IWALKER_COORDINATOR": f"localhost:{free_port()}",
        "IWALKER_PROCESSES": "2",
        "XLA_FLAGS": re.sub(r"(device_count)=\d+", r"\1=1", os.environ["XLA_FLAGS"]),
        "JAX_PLATFORMS": "cpu",
    }
    command = [sys.executable, "-m", "tests.training.working_together", str(folder)]
    running = [
        subprocess.Popen(
            command,
            cwd=Path(__file__).parents[2],
            env=environment | {"IWALKER_PROCESS": str(k)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for k in range(2)
    ]
    try:
        said = [process.communicate(timeout=200)[1] for process in running]
    finally:
        for process in running:
            process.kill()
    if any("implemented on the CPU backend" in text for text in said):
        pytest.skip("this jaxlib has no collectives between processes on CPUs")
    assert [process.returncode for process in running] == [0, 0], "\n".join(said)
    return folder


def test_two_processes_go_on_with_a_run_like_two_devices_of_one(together, small_data):
    """Oracle: the same steps of one process on two devices, from the same checkpoint."""
    one = train_until(ENDED, small_data, together / "one").state
    store = CheckpointStore(together / "run0" / "checkpoints")
    found = store.restore_latest()
    store.close()
    assert found is not None and int(found[0].step) == int(one.step) == ENDED
    assert [line["step"] for line in read_metrics(together / "run0" / "metrics.jsonl")] == list(range(ENDED))
    for a, b in zip(jax.tree.leaves(one.params), jax.tree.leaves(found[0].params), strict=True):
        np.testing.assert_allclose(a, b, atol=2e-5)


def test_two_processes_walk_what_one_does(together, whole_study):
    """Oracle: the study of one process; each of the two has walked one batch of those that were left."""
    folder = together / "study"
    known = load_logs(folder)
    assert len(known) == sum(len(episodes) for episodes in whole_study.groups.values())
    again = run_episode_study(SETTINGS, lambda *_: pytest.fail("nothing is left to walk"), folder, None)
    np.testing.assert_equal(again.groups, whole_study.groups)
    assert {key.policy for key in load_episodes(log_file(folder, 1))} == {"classical"}
    assert len(again.sheets) == 4
