"""The commands on a bag: it is validated, trained on for two epochs, and replayed through the planner."""

import json

import numpy as np
import pytest

from iwalker_jax.api.planner import load_planner
from iwalker_jax.commands import validate_recording
from iwalker_jax.data import load_recording
from iwalker_jax.geometry import host
from tests.data.bags import FRAMES, KINDS, BagDraft
from tests.experiments.commands import shorten_evaluation, train_command

pytestmark = pytest.mark.timeout(300)
DEPTH = "/camera/depth/image_raw/compressedDepth"


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_is_validated(tmp_path, capsys, kind):
    place = BagDraft(compressed=True).write(tmp_path / "walk", kind)
    assert validate_recording.main([str(place)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "4 topics" in out and "5 usable of 5" in out and "usable" in out


def test_a_bag_is_trained_on_and_replayed(tmp_path, monkeypatch):
    """Property: two epochs on compressed depth of a distorting camera, whose planner then answers every frame."""
    shorten_evaluation(monkeypatch)
    place = BagDraft(compressed=True).write(tmp_path / "walk", "ros1")
    run = tmp_path / "run"
    small = ["--batch-size", "4", "--unseen-scenes", "0"]
    assert train_command(run, "--data", str(place), "--topic", DEPTH, *small) == 0
    source = json.loads((run / "config.json").read_text())["source"]
    assert source["topic"] == DEPTH and source["folder"] == str(place)
    planner, recording = load_planner(run), load_recording(place)
    goals = host.to_base(recording.poses, recording.poses[-1, :2])
    for depth, mount, goal in zip(recording.depth_frames(), recording.mounts, goals):
        plan = planner(depth, goal, mount=mount)
        assert np.isfinite(plan.path).all()
    assert len(recording) == FRAMES
