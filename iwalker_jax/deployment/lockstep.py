"""A policy's functions on a simulated robot, one after the other: time stands still while they think."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from iwalker_jax.deployment.functions import Arrays
from iwalker_jax.deployment.simulated_robot import MeasuredState, SimulatedRobot
from iwalker_jax.tasks.task import GOAL_CAPACITY

Function = Callable[[Arrays], Arrays]


class Rates(NamedTuple):
    """Control ticks from one check of the footsteps to the next, and such checks in a camera frame."""

    ticks_per_check: int
    checks_per_frame: int


class Lockstep:
    """The closed loop of a policy's functions.

    Attributes:
        time: [s] since the start.
        frame: what the last camera frame gave; control: what the last tick did.
    """

    def __init__(
        self, functions: Mapping[str, Function], robot: SimulatedRobot, goals: np.ndarray, rates: Rates
    ) -> None:
        """Begin with a robot that stands.

        Args:
            functions: start_control, control, start_frame, frame and footsteps, of a manifest's named arrays.
            robot: to walk.
            goals: (g, 2) [m] world.
            rates: of the three clocks.
        """
        self.functions, self.robot, self.rates, self.time = functions, robot, rates, 0.0
        state = robot.state()
        self.frame: Arrays = functions["start_frame"](_of(state))
        self.control: Arrays = functions["start_control"](_of(state))
        self.goals = goals
        self._spot, self._number = self.frame["spot"], 0
        self._command = {
            **renamed(self.control, "memory.plan.", "command.plan."),
            "command.number": np.int32(0),
            "command.stopping": np.bool_(False),
            "command.touchdowns": np.int32(0),
        }

    def run_frame(self) -> None:
        """One camera frame: see, plan, and walk until the next one."""
        state = self.robot.state()
        self.frame = self.functions["frame"](
            {
                **self.frame,
                **goal_arrays(self.goals),
                "depth": self.robot.depth(),
                "image.qpos": state.qpos,
                "image.qvel": state.qvel,
                **_of(state),
                "time": np.float32(self.time),
            }
        )
        for _ in range(self.rates.checks_per_frame):
            self._plan()
            for _ in range(self.rates.ticks_per_check):
                self._tick()

    def _plan(self) -> None:
        before = self.control
        steps = self.functions["footsteps"](
            {
                **self.frame,
                **_of(self.robot.state()),
                **renamed(before, "clock.", "clock."),
                **renamed(before, "memory.plan.", "plan."),
                "stopping": before["memory.stopping"],
                "spot": self._spot,
            }
        )
        self._spot = steps["spot"]
        if steps["new"] or steps["plan.count"] != before["memory.plan.count"]:
            self._number += 1
            self._command = {
                **renamed(steps, "plan.", "command.plan."),
                "command.number": np.int32(self._number),
                "command.stopping": steps["stopping"],
                "command.touchdowns": before["memory.touchdowns"],
            }

    def _tick(self) -> None:
        self.control = self.functions["control"](
            {**self.control, **_of(self.robot.state()), **self._command, "halt": np.bool_(False)}
        )
        self.robot.step(np.asarray(self.control["torques"]))
        self.time += self.robot.time_step


def renamed(arrays: Mapping[str, Any], before: str, after: str) -> Arrays:
    """Those arrays whose names begin with `before`, under names that begin with `after` instead."""
    return {after + name[len(before) :]: array for name, array in arrays.items() if name.startswith(before)}


def goal_arrays(goals: np.ndarray, capacity: int = GOAL_CAPACITY) -> Arrays:
    """Goals (g, 2) [m] as the camera frame takes them: the last one repeated."""
    rows = np.minimum(np.arange(capacity), len(goals) - 1)
    return {"goals": np.asarray(goals, np.float32)[rows], "goal_count": np.int32(len(goals))}


def _of(state: MeasuredState) -> Arrays:
    return state._asdict()
