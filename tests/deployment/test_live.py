"""Controller, planner and robot as processes of their own: messages, watchdogs, and a walk through the office."""

import multiprocessing
import struct
from pathlib import Path

import numpy as np
import pytest

from iwalker_jax.api import load_planner
from iwalker_jax.commands import run_policy
from iwalker_jax.deployment import exported_functions, write_policy
from iwalker_jax.deployment.live import supervisor
from iwalker_jax.deployment.live.deadlines import Deadlines
from iwalker_jax.deployment.live.messages import HEADER, Kind, MessageError, MessageLayout, read_header
from iwalker_jax.deployment.live.process import WatchdogLimits
from iwalker_jax.deployment.live.simulation import SimulationSettings
from iwalker_jax.deployment.live.sockets import Peer, newest
from iwalker_jax.deployment.live.supervisor import run_live
from iwalker_jax.deployment.lockstep import goal_arrays
from iwalker_jax.errors import InputError
from iwalker_jax.navigation import make_navigator
from iwalker_jax.tasks import named_task
from tests.experiments.commands import fails_with_one_sentence

LAYOUT = MessageLayout(Kind.STATE, {"qpos": ("float32", (3,)), "touching": ("bool", (2,)), "step": ("int32", ())})
LAYOUTS = {Kind.STATE: LAYOUT, Kind.SEEN: MessageLayout(Kind.SEEN, {})}
ARRAYS = {"qpos": np.float32([1, 2, 3]), "touching": np.array([True, False]), "step": np.int32(-7)}


def test_a_message_is_what_the_page_says():
    """Oracle: `struct`, by the table of docs/export.md."""
    content = LAYOUT.pack(5, ARRAYS)
    magic, version, kind, size, number, sent = struct.unpack_from("<4sHHI4xqq", content)
    assert (magic, version, kind, size, number) == (b"IWLK", 1, 1, 18, 5) and sent > 0
    assert struct.unpack_from("<3f2Bi", content, 32) == (1.0, 2.0, 3.0, 1, 0, -7)
    header = read_header(content, LAYOUTS)
    assert (header.kind, header.number, header.sent) == (Kind.STATE, 5, sent)
    arrays = LAYOUT.unpack(content)
    assert {name: array.dtype for name, array in arrays.items()} == {name: a.dtype for name, a in ARRAYS.items()}
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(arrays[name], array)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"IWLK",
        b"OTHER" + bytes(45),
        LAYOUT.pack(1, ARRAYS)[:-1],
        LAYOUT.pack(1, ARRAYS) + b"\0",
        HEADER.pack(b"IWLK", 2, 1, 18, 1, 1) + bytes(18),
        HEADER.pack(b"IWLK", 1, 9, 18, 1, 1) + bytes(18),
        HEADER.pack(b"IWLK", 1, 1, 2**32 - 1, 1, 1) + bytes(18),
    ],
    # A message holds when it was sent: named by its bytes, every worker would have a test of its own.
    ids=["empty", "start", "other", "cut", "long", "version", "kind", "length"],
)
def test_bytes_that_are_no_message_are_refused(content):
    with pytest.raises(MessageError):
        read_header(content, LAYOUTS)


def test_sockets_take_what_is_theirs_and_miss_nobody(tmp_path):
    """Property: messages come in order, garbage is counted, and sending to a peer that is gone is False."""
    robot, controller = Peer(tmp_path, "robot", LAYOUTS), Peer(tmp_path, "controller", LAYOUTS)
    assert controller.receive(0.0) == []
    for number in range(3):
        assert robot.send("controller", Kind.STATE, number, ARRAYS)
    robot._socket.sendto(b"garbage", str(tmp_path / "controller"))
    messages = controller.receive(1.0)
    assert [header.number for header, _ in messages] == [0, 1, 2] and controller.refused == 1
    found = newest(messages, Kind.STATE)
    assert found is not None and found[0].number == 2 and newest(messages, Kind.SEEN) is None
    controller.close()
    assert not robot.send("controller", Kind.STATE, 4, ARRAYS) and not robot.send("absent", Kind.STATE, 4, ARRAYS)
    robot.close()


def test_deadlines_are_counted():
    """Oracle: by hand. Three answers, one of them late, and one question without an answer."""
    deadlines = Deadlines("Loop", 100.0)
    for asked, answered in ((0.0, 0.002), (0.01, 0.012), (0.02, 0.034)):
        deadlines.answered(asked, answered)
    deadlines.skip(1)
    figures = deadlines.punctuality()
    assert (figures.due, figures.missed) == (4, 2)
    assert figures.median == pytest.approx(0.002) and figures.longest == pytest.approx(0.014)
    assert figures.jitter == pytest.approx(0.006)
    assert "2 of 4 deadlines missed (50.000 %)" in figures.sentence()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--goals", "1"], "Where to"),
        ([], "Where to"),
        (["--goals", "nan", "1"], "Where to"),
        (["--simulate", "moon"], "Unknown task"),
        (["--simulate", "office", "--goals", "1", "1"], "goals of its task"),
        (["--goals", "1", "1", "--lockstep"], "belongs to a simulation"),
        (["--goals", "1", "1", "--camera-until", "2"], "belongs to a simulation"),
        (["--simulate", "office", "--seconds", "-1"], "positive time"),
        (["--goals", "1", "1"], "missing"),
    ],
)
def test_options_that_cannot_be_are_said_in_a_sentence(tmp_path, capsys, options, words):
    assert words in fails_with_one_sentence(lambda: run_policy.main([str(tmp_path), *options]), capsys)


def test_a_place_that_sockets_cannot_be_in_is_refused(tmp_path):
    with pytest.raises(InputError, match="too long a name"):
        supervisor._checked(tmp_path / ("x" * 100))


def test_limits_out_of_range_are_refused():
    for limits in ({"planner": 0.0}, {"camera": float("nan")}):
        with pytest.raises(InputError, match="give"):
            WatchdogLimits(**limits)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """The shipped planner, exported but for the networks alone."""
    folder = tmp_path_factory.mktemp("policy")
    navigator = make_navigator("default", load_planner(), sensors="none", depth_noise=False)
    exported = {name: entry for name, entry in exported_functions(navigator).items() if not name.startswith("i")}
    write_policy(folder, navigator, exported, {"policy": "default"})
    return folder


def run(folder: Path, seconds: float, **options):
    """A run in lockstep, so that a busy machine may take its time; what was said, and the report."""
    said: list[str] = []
    settings = {name: options.pop(name) for name in ("camera_until",) if name in options}
    report = run_live(
        folder,
        goal_arrays(named_task("office").goals),
        WatchdogLimits(planner=1.5, camera=3.0),
        simulation=SimulationSettings("office", seconds, lockstep=True, **settings),
        say=said.append,
        **options,
    )
    assert report.simulated is not None
    return said, report


def test_the_robot_walks_through_the_office_by_its_artifacts(policy):
    """Oracle: physics and scene in a process that knows nothing of the policy; it measures way and clearance."""
    _, report = run(policy, 8.0)
    walk = report.simulated
    assert walk.outcome == "ran out of time" and walk.late == 0 and walk.ticks >= 4000
    assert walk.walked > 1.0 and walk.clearance > 0
    assert np.linalg.norm(np.asarray(walk.place) - named_task("office").start[:2]) > 1.0
    assert [loop.name for loop in report.loops] == ["Controller", "Camera frames", "Footsteps"]
    assert report.loops[0].due == walk.ticks and report.refused == 0


def test_a_killed_planner_makes_the_robot_stop_and_stand(policy):
    said, report = run(policy, 30.0, kill_planner_after=4.0)
    walk = report.simulated
    assert (walk.outcome, walk.standing, walk.halted) == ("stood still", True, True)
    assert walk.walked > 0.2 and 4.0 < walk.seconds < 12.0
    assert report.halts == 1 and [loop.name for loop in report.loops] == ["Controller"]
    assert "The planner's process has ended. The controller makes the robot stop and stand." in said


def test_a_silent_camera_makes_the_robot_stop_and_stand(policy):
    _, report = run(policy, 30.0, camera_until=4.0)
    walk = report.simulated
    assert (walk.outcome, walk.standing, walk.halted) == ("stood still", True, False)
    assert 4.0 < walk.seconds < 14.0 and walk.clearance > 0


def test_nothing_is_left_of_a_run():
    """The processes of the runs before have all gone."""
    assert multiprocessing.active_children() == []
