"""The robot that walks on a footstep plan: roll-outs of one robot or many, on MJX or on C MuJoCo."""

from iwalker_jax.walking.batch import (
    BatchResult,
    BrokenRow,
    WalkProgram,
)
from iwalker_jax.walking.commands import (
    CURVE_RADIUS,
    Motion,
    MotionKind,
    Walk,
    load_path,
    make_walk,
    s_curve,
    standing_feet,
)
from iwalker_jax.walking.mujoco_rollout import (
    MujocoRobot,
    roll_out_mujoco,
)
from iwalker_jax.walking.record import (
    TimedFootsteps,
    WalkRecord,
)
from iwalker_jax.walking.replay import (
    TickStates,
    load_dump,
    retrace,
    save_dump,
)
from iwalker_jax.walking.rollout import (
    MAX_DELAY,
    Conditions,
    ControllerMemory,
    ControlOutput,
    Sample,
    Walker,
    WalkState,
    has_fallen,
    roll_out,
    sense_and_control,
    start_walk,
    walk_tick,
)
from iwalker_jax.walking.setup import (
    Disturbances,
    Sensors,
    check_robots,
    default_walker,
    sample_conditions,
)

__all__ = [
    "CURVE_RADIUS",
    "MAX_DELAY",
    "BatchResult",
    "BrokenRow",
    "Conditions",
    "ControlOutput",
    "ControllerMemory",
    "Disturbances",
    "Motion",
    "MotionKind",
    "MujocoRobot",
    "Sample",
    "Sensors",
    "TickStates",
    "TimedFootsteps",
    "Walk",
    "WalkProgram",
    "WalkRecord",
    "WalkState",
    "Walker",
    "check_robots",
    "default_walker",
    "has_fallen",
    "load_dump",
    "load_path",
    "make_walk",
    "retrace",
    "roll_out",
    "roll_out_mujoco",
    "s_curve",
    "sample_conditions",
    "save_dump",
    "sense_and_control",
    "standing_feet",
    "start_walk",
    "walk_tick",
]
