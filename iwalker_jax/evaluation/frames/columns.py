"""The figures of a sequence of frames as columns of a table."""

import numpy as np

from iwalker_jax.evaluation.frames.sequences import SequenceResult
from iwalker_jax.evaluation.tables import Column

FRAME_COLUMNS = (
    Column("feasibility", "1000 x MSE between path and unicycle optimum, lower is better", 3),
    Column("collision", "published map summed over the footsteps, lower is better", 3),
    Column("stability", "1000 x variance of the relative waypoint interval, lower is better", 3),
    Column("H-LIP cost", "cost of the step MPC that follows the footsteps, lower is better", 3),
    Column("steps hit %", "footsteps where the body's footprint touches the true scene", 2),
    Column("paths hit %", "paths on which the footprint touches the true scene anywhere", 1),
    Column("reach %", "goals in view that the path ends within 0.3 m of", 1),
    Column("progress %", "goals out of view towards which the path shortens the true route", 1),
    Column("served %", "both kinds of goals together", 1),
)


def frame_values(result: SequenceResult) -> dict[str, float]:
    """Means over the frames of one sequence, by column title; NaN where a column does not apply."""
    row = {
        "feasibility": float(np.mean(result.plan.feasibility)),
        "collision": float(np.mean(result.plan.collision)),
        "stability": float(np.mean(result.plan.stability)),
        "H-LIP cost": float(np.mean(result.plan.hlip_cost)),
    }
    truth, view, served = result.truth, result.in_view, result.served
    if truth is None or view is None or served is None:
        return row | {column.title: float("nan") for column in FRAME_COLUMNS if column.title not in row}
    return row | {
        "steps hit %": 100.0 * float(np.mean(truth.footsteps_in_collision)),
        "paths hit %": 100.0 * float(np.mean(truth.path_collides)),
        "reach %": _percent(served[view]),
        "progress %": _percent(served[~view]),
        "served %": _percent(served),
    }


def _percent(flags: np.ndarray) -> float:
    return 100.0 * float(np.mean(flags)) if len(flags) else float("nan")
