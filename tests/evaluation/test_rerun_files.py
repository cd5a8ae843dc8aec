"""Files of rerun, read back by rerun itself where it is installed; the figures are those of the record."""

import importlib.util
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bruce_model import crouch_qpos, load_mujoco
from iwalker_jax.commands import validate_recording as command
from iwalker_jax.data import load_recording
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes import row_of
from iwalker_jax.evaluation.rerun_files import require_rerun, write_episode, write_recording, write_walk
from iwalker_jax.evaluation.rerun_files.stream import Skeleton
from iwalker_jax.navigation import Outcome
from tests.data.recording_folders import write_yaml_recording
from tests.evaluation.episode_records import make_record, make_task
from tests.evaluation.walks.test_pictures import make_walk
from tests.experiments.commands import fails_with_one_sentence

needs_rerun = pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="rerun-sdk is not installed")


def logged(file: Path) -> dict[str, list[tuple[float, list[float]]]]:
    """(time or frame, scalars) of what was logged to each entity at a time; an empty list for what is always there."""
    from rerun.chunk import RrdReader

    found: dict[str, list[tuple[float, list[float]]]] = {}
    for chunk in RrdReader(str(file)).stream():
        batch = chunk.to_record_batch()
        rows = found.setdefault(chunk.entity_path.lstrip("/"), [])
        for name, unit in (("time", 1e-9), ("frame", 1.0)):
            if name in batch.schema.names:
                at = batch.column(name).cast("int64").to_pylist()
                scalars = [batch.column(other) for other in batch.schema.names if other.endswith("Scalars:scalars")]
                values = scalars[0].to_pylist() if scalars else [[]] * len(at)
                rows += [(unit * one, value) for one, value in zip(at, values, strict=True)]
    return {entity: sorted(rows) for entity, rows in found.items()}


@needs_rerun
def test_an_episode_is_on_one_time_line(tmp_path):
    record = row_of(make_record(seconds=1.0, images=True), 0)
    file = tmp_path / "episode.rrd"
    write_episode(file, make_task(), record, model=load_mujoco())
    entities = logged(file)
    frames = int(np.flatnonzero(np.asarray(record.outcome) != Outcome.RUNNING)[0]) + 1
    timed = ("robot", "path", "footsteps", "camera", "camera/depth", "map/occupied")
    for name in (*(f"world/{part}" for part in timed), "map", "figures/torque_share", "figures/clearance"):
        at = [time for time, _ in entities[name]]
        np.testing.assert_allclose(at, np.asarray(record.time[:frames]), atol=1e-6, err_msg=name)
    shares = [share for _, (share,) in entities["figures/torque_share"]]
    np.testing.assert_allclose(shares, np.asarray(record.torque_share[:frames]), atol=1e-6)
    assert {"world/scene/boxes", "world/scene/cylinders", "world/goals", "world/walked", "outcome"} <= set(entities)


@needs_rerun
def test_a_walk_has_forces_and_torques(tmp_path):
    walk = make_walk()
    file = tmp_path / "walk.rrd"
    write_walk(file, walk, load_mujoco(), np.tile(crouch_qpos(), (len(walk.time), 1)))
    entities = logged(file)
    known = np.isfinite(walk.com).all(axis=1)
    torques = entities["figures/torques"]
    np.testing.assert_allclose([time for time, _ in torques], walk.time[known], atol=1e-6)
    np.testing.assert_allclose([values for _, values in torques], walk.torques[known], atol=1e-6)
    assert len(entities["world/forces"]) == known.sum()
    assert {"world/footsteps", "world/robot", "world/com"} <= set(entities)


@needs_rerun
def test_a_recording_has_every_usable_frame(tmp_path):
    recording = load_recording(write_yaml_recording(tmp_path / "walk", poses=[[0.1 * k, 0.0, 0.0] for k in range(3)]))
    file = tmp_path / "walk.rrd"
    write_recording(file, recording)
    assert [frame for frame, _ in logged(file)["world/camera/depth"]] == [0, 1, 2]


@needs_rerun
def test_the_command_writes_the_file_that_was_asked_for(tmp_path):
    folder, file = write_yaml_recording(tmp_path / "walk"), tmp_path / "out" / "walk.rrd"
    assert command.main([str(folder), "--rerun", str(file)]) == 0
    assert "world/camera/depth" in logged(file)


def test_lines_of_the_robot_join_its_bodies():
    """Oracle: MuJoCo's own body positions, after its whole forward pass."""
    model = load_mujoco()
    data = mujoco.MjData(model)
    data.qpos[:] = crouch_qpos()
    mujoco.mj_forward(model, data)
    lines = Skeleton(model).lines(crouch_qpos())
    children = [k for k in range(model.nbody) if model.body_parentid[k] > 0]
    np.testing.assert_allclose(lines[:, 1], data.xpos[children])
    np.testing.assert_allclose(lines[:, 0], data.xpos[model.body_parentid[children]])


def test_what_cannot_be_written_is_refused_before_any_work(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    with pytest.raises(InputError, match=r"ends in \.rrd"):
        require_rerun(tmp_path / "file.png")
    (tmp_path / "taken").touch()
    with pytest.raises(InputError, match="cannot be written"):
        require_rerun(tmp_path / "taken" / "file.rrd")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    arguments = [str(tmp_path / "absent"), "--rerun", str(tmp_path / "file.rrd")]
    assert "pip install 'iwalker-jax[rerun]'" in fails_with_one_sentence(lambda: command.main(arguments), capsys)
