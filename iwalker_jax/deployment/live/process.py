"""What the processes of a running policy share: limits of silence, their priority, and how they are told to end."""

import os
import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection

from iwalker_jax.errors import InputError

READY, PROGRESS, DONE = "ready", "progress", "done"
"""What a process says when it can begin, how far it is, and when it has ended."""

BEGIN, END = "begin", "end"
"""What it is told."""

CONTROLLER_PRIORITY, ROBOT_PRIORITY = 20, 30
"""Of the system's real-time priorities, 1 to 99; a robot's clock waits for nobody, and so does a simulated one's."""


@dataclass(frozen=True)
class WatchdogLimits:
    """How long a peer may be silent.

    Attributes:
        planner: [s] after which the controller makes the robot stop and stand.
        camera: [s] without a finished camera frame after which the planner does.
        priority: whether controller and simulated robot ask for real-time scheduling, where the system allows it.
    """

    planner: float = 0.3
    camera: float = 0.5
    priority: bool = True

    def __post_init__(self) -> None:
        if not (0.05 <= self.planner <= 10 and 0.1 <= self.camera <= 10):
            raise InputError(
                f"The planner may be silent for {self.planner} s and the camera for {self.camera} s; give 0.05 to 10 s "
                "and 0.1 to 10 s."
            )


def ignore_interrupts() -> None:
    """Leave Ctrl-C to the supervisor, who tells all processes to end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def prefer(priority: int, threads: bool = True) -> bool:
    """Ask for real-time scheduling of this thread, and of those that it is going to start; False if refused."""
    try:
        policy = os.SCHED_FIFO if threads else os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except (OSError, AttributeError):
        return False
    return True


def told_to_end(supervisor: Connection) -> bool:
    """Whether the supervisor has said so, or has gone."""
    try:
        return supervisor.poll() and supervisor.recv() == END
    except (EOFError, OSError):
        return True
