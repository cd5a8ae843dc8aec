"""How an episode ends and what is recorded of it."""

from enum import IntEnum
from typing import NamedTuple

from jaxtyping import Array, Bool, Float, Int


class Outcome(IntEnum):
    """How an episode ended; the robot cannot know that it is MISTAKEN, only the true state tells."""

    RUNNING = 0
    REACHED = 1
    COLLIDED = 2
    FELL = 3
    GAVE_UP = 4
    TIMED_OUT = 5
    MISTAKEN = 6


SENTENCES = {
    Outcome.RUNNING: "still under way",
    Outcome.REACHED: "stood at its last goal",
    Outcome.COLLIDED: "its body touched an obstacle",
    Outcome.FELL: "fell",
    Outcome.GAVE_UP: "stopped, because it found no way to its goal or saw nothing",
    Outcome.TIMED_OUT: "ran out of time",
    Outcome.MISTAKEN: "stood where it believed its last goal to be, but had not been at all goals",
}


class EpisodeRecord(NamedTuple):
    """What is recorded of episodes at every camera frame; NumPy, batch first, then time.

    A finished episode repeats its last row.

    Attributes:
        time: [s]; outcome: `Outcome` so far; goal: index of the goal being walked to.
        qpos: (23,) true state; base: true and believed: estimated (x, y, yaw) of the base frame, which lies on the
            floor below the COM with x along the torso's heading [m, rad].
        feet: (2, 3) [m] true, right and left.
        path: (n, 2) [m] planned, world frame.
        footsteps: (m, 2) [m] planned, world frame; first_side: `Side` of the first, from which they alternate.
        clearance: [m] between the body's volume and the nearest obstacle; negative inside.
        stopped: whether the robot holds still for its own safety (blind or frozen camera, no way).
        detour: whether the classical route took the place of a path of iPath's that led nowhere.
        torque_share: largest motor torque since the last frame over its limit.
        qp_failures: ticks since the last frame whose whole-body QP did not converge.
        depth: (height, width) float16 [m] as the planner sees it, and
        occupied: (n, n) its remembered map, a window with the world's axes around the believed base; both only where
            images are kept, else empty.

    What the planner saw and planned (`believed`, `path`, `depth`) belong to the frame's start, the rest to its end.
    """

    time: Float[Array, "*n"]
    outcome: Int[Array, "*n"]
    goal: Int[Array, "*n"]
    qpos: Float[Array, "*n nq"]
    base: Float[Array, "*n 3"]
    believed: Float[Array, "*n 3"]
    feet: Float[Array, "*n 2 3"]
    path: Float[Array, "*n p 2"]
    footsteps: Float[Array, "*n m 2"]
    first_side: Int[Array, "*n"]
    clearance: Float[Array, "*n"]
    stopped: Bool[Array, "*n"]
    detour: Bool[Array, "*n"]
    torque_share: Float[Array, "*n"]
    qp_failures: Int[Array, "*n"]
    depth: Float[Array, "*n h w"]
    occupied: Bool[Array, "*n rows columns"]
