"""How an episode ends and what is recorded of it."""

from enum import IntEnum
from typing import NamedTuple

from jaxtyping import Array, Bool, Float, Int, Int8


class Outcome(IntEnum):
    """How an episode ended; the robot cannot know that it is MISTAKEN, only the true state tells."""

    RUNNING = 0
    REACHED = 1
    COLLIDED = 2
    FELL = 3
    GAVE_UP = 4
    TIMED_OUT = 5
    MISTAKEN = 6

    @property
    def word(self) -> str:
        """The outcome in a word or two."""
        return _DESCRIPTIONS[self].word

    @property
    def sentence(self) -> str:
        """What the robot did, to follow its name."""
        return _DESCRIPTIONS[self].sentence

    @property
    def colour(self) -> str:
        """Of the outcome in pictures and pages, as #rrggbb."""
        return _DESCRIPTIONS[self].colour

    @property
    def rgb(self) -> tuple[int, int, int]:
        """The same colour as numbers of 8 bits."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return red, green, blue


class _Description(NamedTuple):
    word: str
    sentence: str
    colour: str


_DESCRIPTIONS = {
    Outcome.RUNNING: _Description("under way", "still under way", "#737373"),
    Outcome.REACHED: _Description("reached", "stood at its last goal", "#2ca02c"),
    Outcome.COLLIDED: _Description("collided", "its body touched an obstacle", "#d62728"),
    Outcome.FELL: _Description("fell", "fell", "#9467bd"),
    Outcome.GAVE_UP: _Description("gave up", "stopped, because it found no way to its goal or saw nothing", "#ff7f0e"),
    Outcome.TIMED_OUT: _Description("timed out", "ran out of time", "#8c564b"),
    Outcome.MISTAKEN: _Description(
        "mistaken", "stood where it believed its last goal to be, but had not been at all goals", "#bcbd22"
    ),
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
        cells: (n, n) `MapCell`s of its remembered map, a window with the world's axes around the believed base; both
            only where images are kept, else empty.

    What the planner saw (`believed`, `depth`) belongs to when the image that it plans on was taken: the frame's
    start, or as many frames earlier as images are late; `path` belongs to the frame's start, the rest to its end.
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
    cells: Int8[Array, "*n rows columns"]
