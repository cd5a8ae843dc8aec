"""Are artifacts what they were made of? Both see the same walk, and every output is compared bit by bit."""

from collections.abc import Callable, Mapping
from pathlib import Path

import jax
import numpy as np

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.exported_functions import exported_functions
from iwalker_jax.deployment.functions import Arrays
from iwalker_jax.deployment.lockstep import Function, Lockstep, Rates
from iwalker_jax.deployment.simulated_robot import SimulatedRobot
from iwalker_jax.geometry import host
from iwalker_jax.navigation.navigators import Navigator
from iwalker_jax.planning import PATH_POINTS
from iwalker_jax.tasks import named_task

SCENE = "office"

_ROWS = 2  # of a batch that the networks see


def differing_frames(
    folder: Path,
    navigator: Navigator,
    frames: int,
    seed: int = 0,
    on_progress: Callable[[int, str], None] = lambda done, note: None,
) -> dict[str, int]:
    """How many calls of each artifact gave other bits than the function it was made of, along a walk by sight.

    Args:
        folder: of the artifacts.
        navigator: that they were made of.
        frames: camera frames to walk.
        seed: of the robot and its camera.
        on_progress: hears of the frames so far.

    Raises:
        ArtifactError: if the folder cannot be used.
    """
    on_progress(0, "compiling, a minute or two the first time")
    artifacts = loader.load(folder)
    differing: dict[str, int] = {}

    def compared(name: str, function: Function) -> Function:
        def call(arrays: Arrays) -> Arrays:
            artifact = artifacts[name]
            inputs = artifact.checked(arrays)
            outputs, others = jax.device_get((function(inputs), artifact.call(inputs)))
            if not same_bits(outputs, others):
                differing[name] = differing.get(name, 0) + 1
            return outputs

        return call

    functions = {name: compared(name, jax.jit(entry.function)) for name, entry in exported_functions(navigator).items()}
    walk_in_office(functions, navigator, frames, seed, on_progress)
    return differing


def walk_in_office(
    functions: Mapping[str, Function],
    navigator: Navigator,
    frames: int,
    seed: int = 0,
    on_progress: Callable[[int, str], None] = lambda done, note: None,
) -> None:
    """Call all of a policy's functions along a walk through the office, the networks with what the robot sees there."""
    task = named_task(SCENE, seed)
    robot = SimulatedRobot(task, navigator.intrinsics, seed)
    rates = Rates(navigator.loop.ticks_per_check, navigator.loop.checks_per_frame)
    loop = Lockstep(functions, robot, task.goals, rates)
    mount = np.asarray(navigator.planner.merge().config.ipath.mount.as_array(), np.float32)
    random = np.random.default_rng(seed)
    for number in range(frames):
        loop.run_frame()
        goal = host.to_base(np.asarray(loop.frame["base"]), task.goals[int(loop.frame["memory.goal"])])
        _call_networks(functions, loop.frame, goal, mount, random)
        on_progress(number + 1, SCENE)


def _call_networks(
    functions: Mapping[str, Function], frame: Arrays, goal: np.ndarray, mount: np.ndarray, random: np.random.Generator
) -> None:
    """Let both networks plan for a frame and as many other goals and robot states as there are rows."""
    goals = np.stack([goal, *(goal + random.uniform(-1, 1, 2) for _ in range(_ROWS - 1))]).astype(np.float32)
    depth = np.stack([np.asarray(frame["memory.health.last"])] * _ROWS)
    functions["ipath"]({"depth": depth, "goal": goals, "mount": np.stack([mount] * _ROWS)})
    ahead = np.linspace(0.0, 1.0, PATH_POINTS)[:, None]
    signs = np.sign(random.uniform(-1, 1, _ROWS))
    functions["istepper"](
        {
            "path": np.stack([ahead * to for to in goals]).astype(np.float32),
            "com_from_stance": random.uniform(-0.05, 0.05, (_ROWS, 2)).astype(np.float32),
            "com_velocity": random.uniform(-0.3, 0.3, (_ROWS, 2)).astype(np.float32),
            "stance_sign": signs.astype(np.float32),
            "time_in_step": random.uniform(0.0, 0.2, _ROWS).astype(np.float32),
        }
    )


def same_bits(outputs: Arrays, others: Arrays) -> bool:
    """Whether two sets of named arrays have the same names, types, shapes and bits."""
    if outputs.keys() != others.keys():
        return False
    pairs = ((np.asarray(outputs[name]), np.asarray(others[name])) for name in outputs)
    return all(a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
