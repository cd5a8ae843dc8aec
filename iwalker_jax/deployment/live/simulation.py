"""The robot's process, simulated: physics by C MuJoCo in real time, states, images and torques as messages."""

import math
import os
import threading
import time
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iwalker_jax.deployment import loader
from iwalker_jax.deployment.live.messages import Arrays, Kind, layouts_of
from iwalker_jax.deployment.live.process import (
    BEGIN,
    DONE,
    PROGRESS,
    READY,
    ROBOT_PRIORITY,
    WatchdogLimits,
    ignore_interrupts,
    prefer,
    told_to_end,
)
from iwalker_jax.deployment.live.sockets import CONTROLLER, PLANNER, ROBOT, Peer, newest

ARRIVAL = 0.45  # [m] of the true robot from its goal: it stops where it believes to be within 0.30 m, and sways
STANDS = 1.0  # [s] of standing after which a robot that was made to halt, or is at its goal, has come to rest
_PATIENCE = 10.0  # [s] without an answer, after which nobody is there

_STAND = 0  # the step clock's mode


@dataclass(frozen=True)
class SimulationSettings:
    """What is simulated.

    Attributes:
        task: name of a task.
        seconds: [s] of simulated time at most.
        seed: of the robot, its task and its camera.
        lockstep: physics waits for torques and for images to be planned on, as long as a slow or busy machine takes.
        camera_until: [s] after which no image comes any more.
    """

    task: str = "office"
    seconds: float = 60.0
    seed: int = 0
    lockstep: bool = False
    camera_until: float = math.inf


class SimulatedRun(NamedTuple):
    """What became of the robot.

    Attributes:
        outcome: reached, stood still, fell, collided, ran out of time, or lost its controller.
        seconds: [s] simulated, and wall: [s] that it took.
        walked: [m] along the base's track, place by place of the camera frames.
        clearance: [m] least distance of the body to obstacles.
        ticks: of the controller; late: of them whose torques had not come within the tick.
        standing: it stands on both feet in the end; halted: the controller had lost the planner.
        place: (2,) x, y [m] in the end.
    """

    outcome: str
    seconds: float
    wall: float
    walked: float
    clearance: float
    ticks: int
    late: int
    standing: bool
    halted: bool
    place: tuple[float, float]


def run_simulation(
    folder: Path, place: Path, limits: WatchdogLimits, settings: SimulationSettings, supervisor: Connection
) -> None:
    """Simulate until the robot comes to an end, or until told to; then report a `SimulatedRun`.

    Args:
        folder: of the exported policy, for the messages' layout.
        place: of the sockets.
        limits: say whether to ask for real-time scheduling.
        settings: of the simulation.
        supervisor: hears `READY`, `PROGRESS` with the simulated time, and in the end `DONE`.
    """
    ignore_interrupts()
    from iwalker_jax.runtime.settings import configure_runtime

    configure_runtime()
    from iwalker_jax.deployment.simulated_robot import SimulatedRobot
    from iwalker_jax.perception import Intrinsics
    from iwalker_jax.tasks import named_task

    manifest = loader.read_manifest(folder)
    task = named_task(settings.task, settings.seed)
    robot = SimulatedRobot(task, Intrinsics(**manifest["camera"]), settings.seed)
    robot.depth(), robot.clearance()
    rate, frame_rate = (manifest["functions"][name]["rate_hz"] for name in ("control", "frame"))
    peer = Peer(place, ROBOT, layouts_of(manifest))
    if limits.priority and not settings.lockstep:
        prefer(ROBOT_PRIORITY, threads=False)
    supervisor.send((READY, None))
    if supervisor.recv() == BEGIN:
        run = _Simulation(robot, peer, settings, np.asarray(task.goals[-1]), round(rate / frame_rate), supervisor)
        supervisor.send((DONE, run.run()))
        run.close()
    peer.close()


class _Simulation:
    """One run."""

    def __init__(
        self,
        robot: Any,
        peer: Peer,
        settings: SimulationSettings,
        goal: np.ndarray,
        per_frame: int,
        supervisor: Connection,
    ) -> None:
        self.robot, self.peer, self.settings, self.goal = robot, peer, settings, goal
        self.per_frame, self.supervisor = per_frame, supervisor
        self.answer: Arrays = {}
        self.answered, self.seen, self.late = -1, -1, 0
        self.clearance, self.walked, self.rested = math.inf, 0.0, 0.0
        self.places: list[np.ndarray] = []
        self._camera = threading.Lock()

    def run(self) -> SimulatedRun:
        """Step until an end."""
        began, tick, outcome = time.monotonic(), 0, ""
        while not outcome:
            outcome = self._tick(tick, began) or (self._look(tick) if tick % self.per_frame == 0 else "")
            tick += 1
            if tick == 1:
                # What comes before the first answer is the others' start.
                began = time.monotonic() - self.robot.time_step
        place = self.robot.state().qpos[:2]
        return SimulatedRun(
            outcome=outcome,
            seconds=tick * self.robot.time_step,
            wall=time.monotonic() - began,
            walked=self.walked,
            clearance=self.clearance,
            ticks=tick,
            late=self.late,
            standing=bool(self.answer) and int(self.answer["clock.mode"]) == _STAND and not self.answer["fallen"],
            halted=bool(self.answer) and bool(self.answer["halted"]),
            place=(float(place[0]), float(place[1])),
        )

    def close(self) -> None:
        """Wait for the image under way: a process that ends within one is aborted."""
        self._camera.acquire(timeout=5.0)

    def _tick(self, tick: int, began: float) -> str:
        """Tell the state, wait for torques, or in real time for the tick's end, and step; says if nobody answers."""
        self.peer.send(CONTROLLER, Kind.STATE, tick, self.robot.state()._asdict())
        due = began + (tick + 1) * self.robot.time_step
        waits = self.settings.lockstep or tick == 0
        self._hear(tick, time.monotonic() + _PATIENCE if waits else due, early=waits)
        if self.answered < tick:
            self.late += 1
            if waits or tick - self.answered > _PATIENCE / self.robot.time_step:
                return "lost its controller"
        if self.settings.lockstep:
            # Never faster than real time, by which the others count silence.
            time.sleep(max(due - time.monotonic(), 0.0))
        self.robot.step(np.asarray(self.answer["torques"]))
        return ""

    def _hear(self, tick: int, until: float, early: bool) -> None:
        """Take in messages up to a time [s], or until the tick's answer is there."""
        while (left := until - time.monotonic()) > 0 and not (early and self.answered >= tick):
            messages = self.peer.receive(left)
            torques, seen = newest(messages, Kind.TORQUES), newest(messages, Kind.SEEN)
            if torques is not None:
                self.answered, self.answer = torques[0].number, torques[1]
            if seen is not None:
                self.seen = seen[0].number

    def _look(self, tick: int) -> str:
        """Take an image if there is a camera left, and judge the robot; the outcome, or nothing yet."""
        state, now = self.robot.state(), tick * self.robot.time_step
        self.supervisor.send((PROGRESS, now))
        if told_to_end(self.supervisor):
            return "was told to end"
        if now < self.settings.camera_until:
            if self.settings.lockstep:
                self._take(tick, state, now)
                self._wait_for_sight(tick)
            else:
                threading.Thread(target=self._take, args=(tick, state, now), daemon=True).start()
        self.clearance = min(self.clearance, self.robot.clearance())
        if self.places:
            self.walked += float(np.linalg.norm(state.qpos[:2] - self.places[-1]))
        self.places.append(state.qpos[:2])
        return self._outcome(state, now)

    def _outcome(self, state: Any, now: float) -> str:
        if self.answer["fallen"]:
            return "fell"
        if self.clearance < 0:
            return "collided"
        arrived = float(np.linalg.norm(state.qpos[:2] - self.goal)) < ARRIVAL
        stands = int(self.answer["clock.mode"]) == _STAND and self.walked > 0.05
        self.rested = self.rested + self.per_frame * self.robot.time_step if stands else 0.0
        if self.rested >= STANDS:
            return "reached" if arrived else "stood still"
        return "ran out of time" if now >= self.settings.seconds else ""

    def _take(self, tick: int, state: Any, now: float) -> None:
        """Render from a state and send; if the last image is still being rendered, this one is left out."""
        if not self._camera.acquire(blocking=False):
            return
        try:
            image = {"depth": self.robot.depth_from(state.qpos), "image.qpos": state.qpos, "image.qvel": state.qvel}
            self.peer.send(PLANNER, Kind.IMAGE, tick, {**image, "time": np.float32(now)})
        except BaseException:
            # A robot that breaks in its camera's thread is to be missed as one that breaks elsewhere.
            traceback.print_exc()
            os._exit(1)
        finally:
            self._camera.release()

    def _wait_for_sight(self, tick: int) -> None:
        """Wait until an image has been planned on, or no planner is left to do so."""
        until = time.monotonic() + 1.0
        while self.seen < tick and time.monotonic() < until:
            self._hear(tick + 1, time.monotonic() + 0.005, early=True)
