"""Picture sheets of evaluated frames: depth, map with the path before and after the MPC, footsteps, distance field."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure, show_on_ground
from iwalker_jax.evaluation.frames.sequences import FrameSequence, SequenceResult
from iwalker_jax.geometry import footstep_signs

_VIEW = (-0.6, 5.0, 2.4)
"""[m] rear, front and half width of the ground shown."""


def save_sheet(sequence: FrameSequence, result: SequenceResult, file: Path, frames: int = 6) -> None:
    """Write a PNG with `frames` evenly spaced frames of a sequence, one a column.

    Args:
        sequence: what was evaluated.
        result: its evaluation.
        file: PNG to write; its folder is created.
        frames: columns.
    """
    count = min(frames, len(sequence.frames))
    chosen = np.unique(np.linspace(0, len(sequence.frames) - 1, count).round().astype(int))
    figure, axes = pyplot().subplots(4, len(chosen), figsize=(3.1 * len(chosen), 13.0), squeeze=False)
    for column, i in enumerate(chosen.tolist()):
        _depth(axes[0, column], sequence, result, i)
        _map(axes[1, column], result, i)
        _footsteps(axes[2, column], result, i)
        _distance_field(axes[3, column], result, i)
    for axis, label in zip(axes[:, 0], ("depth image", "local map and path", "footsteps", "distance field")):
        axis.set_ylabel(label)
    axes[1, 0].legend(loc="lower left", fontsize=6)
    axes[2, 0].legend(loc="lower left", fontsize=6)
    figure.suptitle(_title(result))
    figure.tight_layout()
    save_figure(figure, file)


def _title(result: SequenceResult) -> str:
    plan = result.plan
    text = (
        f"{result.name}, plans as they are: feasibility {plan.feasibility.mean():.2f}, "
        f"collision {plan.collision.mean():.2f}, stability {plan.stability.mean():.2f}"
    )
    if result.truth is not None and result.served is not None:
        text += (
            f"; footsteps in true collision {100 * result.truth.footsteps_in_collision.mean():.1f} %, "
            f"goals served {100 * result.served.mean():.0f} %"
        )
    return text


def _depth(axis: Axes, sequence: FrameSequence, result: SequenceResult, i: int) -> None:
    axis.imshow(np.ma.masked_equal(sequence.frames.depth_metres()[i], 0.0), vmin=0.0, vmax=6.0, cmap="viridis_r")
    axis.set_xticks([])
    axis.set_yticks([])
    axis.set_title(f"frame {i}, fear {result.fear[i]:.2f}", fontsize=8)


def _ground(axis: Axes, values: np.ndarray, result: SequenceResult, i: int, **options: Any) -> None:
    """Draw a map as seen from above, x up and y to the left, with robot and goal."""
    show_on_ground(axis, values, **options)
    rear, front, half = _VIEW
    axis.plot(0, 0, "k^", markersize=6)
    axis.plot(
        np.clip(result.goals[i, 1], -half + 0.1, half - 0.1),
        np.clip(result.goals[i, 0], rear + 0.1, front - 0.1),
        "*",
        color="magenta",
        markersize=11,
    )
    axis.set_xlim(half, -half)
    axis.set_ylim(rear, front)
    axis.tick_params(labelsize=6)


def _map(axis: Axes, result: SequenceResult, i: int) -> None:
    shown = np.where(result.maps.occupied[i], 0.0, np.where(result.maps.unknown[i], 0.6, 1.0))
    _ground(axis, shown, result, i, cmap="gray", vmin=0.0, vmax=1.0)
    axis.plot(result.path[i, :, 1], result.path[i, :, 0], "-", color="tab:red", label="path (iPath)")
    axis.plot(result.tracked[i, :, 1], result.tracked[i, :, 0], "--", color="tab:cyan", label="after the MPC")
    axis.set_title(f"feas {result.plan.feasibility[i]:.2f}  stab {result.plan.stability[i]:.1f}", fontsize=7)


def _footsteps(axis: Axes, result: SequenceResult, i: int) -> None:
    shown = np.where(result.maps.occupied[i], 0.0, 1.0)
    _ground(axis, shown, result, i, cmap="gray", vmin=0.0, vmax=1.0)
    left = np.asarray(footstep_signs(result.stance_sign[i], result.footsteps.shape[1])) > 0
    for side, label in ((left, "left"), (~left, "right")):
        steps = result.footsteps[i, side]
        axis.plot(steps[:, 1], steps[:, 0], "s", color=FOOT_COLOURS[label], ms=3, label=label)
    axis.plot(result.path[i, :, 1], result.path[i, :, 0], "-", color="tab:red", linewidth=0.7)
    reach = max(1.2, float(np.abs(result.footsteps[i]).max()) + 0.2)
    axis.set_xlim(0.6 * reach, -0.6 * reach)
    axis.set_ylim(-0.3, reach - 0.1)


def _distance_field(axis: Axes, result: SequenceResult, i: int) -> None:
    _ground(axis, np.asarray(result.maps.esdf[i]), result, i, cmap="RdYlGn", vmin=-0.3, vmax=1.0)
    axis.plot(result.path[i, :, 1], result.path[i, :, 0], "-", color="black", linewidth=0.8)
