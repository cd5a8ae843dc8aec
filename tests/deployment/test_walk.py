"""A whole policy, exported: the same bits as in process along a walk, and what makes a robot stop and stand."""

import subprocess
import sys
import textwrap

import jax
import numpy as np
import pytest

from iwalker_jax.control import GaitMode, make_plan, velocity_footsteps
from iwalker_jax.deployment.exported_functions import exported_functions
from iwalker_jax.deployment.lockstep import renamed
from iwalker_jax.deployment.rehearsal import SCENE, walk_in_office
from iwalker_jax.deployment.simulated_robot import SimulatedRobot
from iwalker_jax.deployment.writer import write_policy
from iwalker_jax.tasks import named_task
from tests.deployment.folders import small_navigator

FRAMES = 2

ROWS = 20  # of a plan


@pytest.fixture(scope="module")
def navigator():
    return small_navigator()


@pytest.fixture(scope="module")
def exported(navigator):
    return exported_functions(navigator)


@pytest.fixture(scope="module")
def functions(exported):
    """All functions in this process, compiled when they are first called."""
    return {name: jax.jit(entry.function) for name, entry in exported.items()}


def test_artifacts_give_the_same_bits_with_jax_alone(functions, exported, navigator, tmp_path):
    """Oracle: the functions in this process. The artifacts run in one that may not import what made them."""
    write_policy(tmp_path, navigator, exported, {"policy": "default"})
    calls = []

    def recorded(name):
        def call(arrays):
            inputs = {key: np.asarray(arrays[key]) for key in exported[name].inputs}
            outputs = jax.device_get(functions[name](inputs))
            calls.append((name, inputs, outputs))
            return outputs

        return call

    walk_in_office({name: recorded(name) for name in exported}, navigator, FRAMES)
    assert len([name for name, _, _ in calls if name == "control"]) == 33 * FRAMES
    for number, (name, inputs, outputs) in enumerate(calls):
        arrays = {f"i {key}": value for key, value in inputs.items()}
        arrays |= {f"o {key}": value for key, value in outputs.items()}
        np.savez(tmp_path / f"call_{number}_{name}.npz", **arrays)
    script = """
        import sys

        class Forbid:
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in ("iwalker_jax", "bruce_model", "flax", "orbax", "optax", "mujoco", "cv2"):
                    raise ImportError(name)

        sys.meta_path.insert(0, Forbid())
        import load_policy
        load_policy.use_settings(".")
        import glob
        import numpy as np
        policy = load_policy.load(".")
        files = glob.glob("call_*.npz")
        for file in files:
            calls = dict(np.load(file))
            name = file[:-4].split("_", 2)[2]
            outputs = policy[name]({key[2:]: value for key, value in calls.items() if key[0] == "i"})
            wanted = {key[2:]: value for key, value in calls.items() if key[0] == "o"}
            assert outputs.keys() == wanted.keys(), name
            for key, value in wanted.items():
                other = np.asarray(outputs[key])
                assert other.dtype == value.dtype and other.tobytes() == value.tobytes(), (file, key, value, other)
        print("same bits in", len(files))
        """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], cwd=tmp_path, capture_output=True, text=True, timeout=500
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"same bits in {len(calls)}\n"


class Walking:
    """A robot and its controller, tick by tick."""

    def __init__(self, functions):
        self.functions = functions
        self.robot = SimulatedRobot(named_task(SCENE), noise=None)
        self.memory = functions["start_control"](self.robot.state()._asdict())
        feet = np.asarray(self.memory["memory.controller.gait.home"])
        yaw = float(feet[:, 2].mean())
        positions, yaws = velocity_footsteps(0.1, 0.0, 0.0, ROWS, 0.25, 0.1, 1)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        plan = make_plan(positions @ turn.T + feet[:, :2].mean(axis=0), yaws + yaw, 1, ROWS)
        self.command = {f"command.plan.{part}": np.asarray(array) for part, array in plan._asdict().items()}
        self.command |= {
            "command.number": np.int32(1),
            "command.stopping": np.bool_(False),
            "command.touchdowns": np.int32(0),
        }

    def ticks(self, count, halt=False, **command):
        """Walk on; by name, the step clock at every tick."""
        changed = {f"command.{name}": value for name, value in command.items()}
        modes = []
        for _ in range(count):
            self.memory = self.functions["control"](
                {**self.memory, **self.robot.state()._asdict(), **self.command, **changed, "halt": np.bool_(halt)}
            )
            self.robot.step(np.asarray(self.memory["torques"]))
            modes.append(int(self.memory["clock.mode"]))
        return modes


@pytest.fixture
def walking(functions):
    """A robot in its third or fourth step."""
    walking = Walking(functions)
    modes = walking.ticks(1000)
    assert modes[0] == GaitMode.STAND and modes[-1] == GaitMode.WALK and walking.memory["memory.touchdowns"] >= 2
    return walking


def test_a_robot_that_is_to_halt_closes_its_feet_and_stands(walking):
    """Property: within two seconds it stands, stays up, and takes no footsteps while it is told to halt."""
    modes = walking.ticks(1000, halt=True)
    assert modes[-1] == GaitMode.STAND and not walking.memory["fallen"]
    place = walking.robot.state().qpos[:2]
    modes = walking.ticks(500, halt=True, number=np.int32(2))
    assert set(modes) == {GaitMode.STAND}
    assert np.linalg.norm(walking.robot.state().qpos[:2] - place) < 0.01
    # A robot that may go again takes the footsteps that come then.
    assert walking.ticks(500, number=np.int32(3))[-1] != GaitMode.STAND


def test_footsteps_of_an_earlier_step_come_too_late(walking):
    """A plan made before the last touchdown is left alone: it would begin with the foot that has just landed."""
    before = renamed(walking.memory, "memory.plan.", "")
    touchdowns = walking.memory["memory.touchdowns"]
    moved = {"number": np.int32(2), "plan.positions": walking.command["command.plan.positions"] + 0.01}
    walking.ticks(1, touchdowns=touchdowns - 1, **moved)
    assert walking.memory["memory.plan_number"] == 1
    np.testing.assert_array_equal(walking.memory["memory.plan.positions"], before["positions"])
    walking.ticks(1, touchdowns=walking.memory["memory.touchdowns"], **moved)
    assert walking.memory["memory.plan_number"] == 2
    np.testing.assert_array_equal(walking.memory["memory.plan.positions"], moved["plan.positions"])


@pytest.mark.parametrize("spoilt", ["lying", "NaN"])
def test_a_robot_that_lies_gets_no_torques(functions, spoilt):
    robot = Walking(functions)
    state = robot.robot.state()._asdict()
    state["qpos"] = np.where(np.arange(len(state["qpos"])) == 2, 0.1 if spoilt == "lying" else np.nan, state["qpos"])
    state["qpos"] = state["qpos"].astype(np.float32)
    outputs = functions["control"]({**robot.memory, **state, **robot.command, "halt": np.bool_(False)})
    assert outputs["fallen"] and not np.any(outputs["torques"])
    np.testing.assert_array_equal(outputs["clock.time"], robot.memory["clock.time"])
