"""The figures of a sequence of frames as columns of a table."""

import numpy as np

from iwalker_jax.evaluation.frames.metrics import GOAL_TOLERANCE, MIN_PROGRESS
from iwalker_jax.evaluation.frames.sequences import SequenceResult
from iwalker_jax.evaluation.frames.shortfall import charged
from iwalker_jax.evaluation.tables import Column

_CHARGE = "a plan that does not serve its goal is charged a footstep gone wrong; lower is better"

_PAPER_METRICS = {
    "feasibility": ("feasibility", "1000 x MSE between path and unicycle optimum"),
    "H-LIP cost": ("hlip_cost", "cost of the step MPC that follows the footsteps"),
    "collision": ("collision", "published map summed over the footsteps"),
    "collision 1 cm": ("collision_published", "published map summed over 150 step centres of 1 cm, as published"),
    "stability": ("stability", "1000 x variance of the relative waypoint interval"),
}
"""Titles of the paper's metrics, their names in `PlanMetrics`, and what they are."""

FRAME_COLUMNS = (
    *(Column(title, f"{meaning}; {_CHARGE}", 3) for title, (_, meaning) in _PAPER_METRICS.items()),
    Column("steps hit %", "footsteps where the body's footprint touches the true scene", 2),
    Column("paths hit %", "paths on which the footprint touches the true scene anywhere", 1),
    Column("reach %", f"goals in view that a path free of hits ends within {GOAL_TOLERANCE:g} m of", 1),
    Column(
        "progress %",
        f"goals out of view towards which a path free of hits shortens the true route by {MIN_PROGRESS:g} m",
        1,
    ),
    Column("served %", "both kinds of goals together", 1),
)
"""Columns of the table of plans on single frames, in order."""

UNCHARGED_COLUMNS = tuple(
    Column(f"uncharged {title}", f"{meaning}; nothing is charged, so that standing still wins", 3)
    for title, (_, meaning) in _PAPER_METRICS.items()
)
"""The paper's metrics as published; `frame_values` has them too."""


def frame_values(result: SequenceResult) -> dict[str, float]:
    """Means over the frames of one sequence, by column title, and the number of frames; NaN where a column does not
    apply.

    Without ground truth nobody knows which plans serve their goals, and nothing is charged.
    """
    row = {"frames": float(len(result.goals))}
    for prefix, values in (("", charged(result.plan, result.served)), ("uncharged ", charged(result.plan, None))):
        row |= {prefix + title: float(np.mean(values[name])) for title, (name, _) in _PAPER_METRICS.items()}
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
