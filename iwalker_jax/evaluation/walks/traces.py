"""Walks as seen from above: COM traces and footsteps, of one robot or of many side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure
from iwalker_jax.geometry import Side
from iwalker_jax.walking import WalkRecord

_MARK_LENGTH = 0.045
"""[m] drawn of a line foot, about its middle; steps of one foot are often shorter than the whole foot."""


def save_trace_grid(
    records: Sequence[WalkRecord], file: Path, titles: Sequence[str] | None = None, columns: int = 4
) -> None:
    """Write a PNG with several robots' traces and footsteps from above, to one scale.

    Args:
        records: the walks.
        file: PNG to write; its folder is created.
        titles: one for each walk; by default they are numbered.
        columns: most panels in a row.

    Raises:
        InputError: no walks, another number of titles, or a file that cannot be written.
    """
    titles = [f"robot {i}" for i in range(len(records))] if titles is None else titles
    if not records or len(titles) != len(records):
        raise InputError(f"There are {len(records)} walks and {len(titles)} titles; give at least one, a title each.")
    columns = min(columns, len(records))
    rows = -(-len(records) // columns)
    low, high = ground_extent(records)
    width = 16.0 / max(columns, 2)
    height = float(np.clip(width * (high[1] - low[1]) / (high[0] - low[0]), 0.2 * width, 2.0 * width)) + 0.4
    size = (width * columns, height * rows + 0.5)
    figure, axes = pyplot().subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for axis in axes.flat[len(records) :]:
        axis.set_axis_off()
    for axis, record, title in zip(axes.flat, records, titles):
        draw_from_above(axis, record, low, high)
        axis.set_title(f"{title}: {travelled(record):.2f} m", fontsize=8)
        axis.set_xlabel("")
        axis.set_ylabel("")
        axis.tick_params(labelsize=6)
        axis.grid(alpha=0.25)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", fontsize=8, ncols=6)
    save_figure(figure, file)


def draw_from_above(axis: Axes, record: WalkRecord, low: np.ndarray, high: np.ndarray) -> None:
    """Draw a walk as seen from above, x to the right and y up, on the ground between two corners [m]."""
    if record.path is not None:
        axis.plot(record.path[:, 0], record.path[:, 1], "-", color="tab:red", linewidth=1.0, label="path")
    axis.plot(record.com[:, 0], record.com[:, 1], "-", color="black", linewidth=0.9, label="COM")
    planned = record.planned
    for side in Side:
        foot = side.name.lower()
        mine = planned.sides == side
        _feet(axis, planned.positions[mine], planned.yaws[mine], color="0.65", linewidth=4.5, label="planned")
        made = record.actual[mine]
        _feet(axis, made[:, :2], made[:, 2], color=FOOT_COLOURS[foot], linewidth=1.8, label=f"{foot} foot")
    axis.plot(*record.com[0, :2], "k^", markersize=6)
    axis.update_datalim([low, high])
    axis.margins(0.0)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("x [m]", fontsize=8)
    axis.set_ylabel("y [m]", fontsize=8)


def _feet(axis: Axes, positions: np.ndarray, yaws: np.ndarray, label: str, **options: Any) -> None:
    """Draw line feet; a label that the axis has already is not repeated."""
    if label in axis.get_legend_handles_labels()[1]:
        label = "_"
    half = 0.5 * _MARK_LENGTH * np.stack([np.cos(yaws), np.sin(yaws)], axis=1)
    gap = np.full_like(positions, np.nan)
    segments = np.stack([positions - half, positions + half, gap], axis=1).reshape(-1, 2)
    axis.plot(segments[:, 0], segments[:, 1], "-", solid_capstyle="butt", label=label, **options)


def ground_extent(records: Sequence[WalkRecord]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [m] of the ground that walks need."""
    points = [p for r in records for p in (r.com[:, :2], r.planned.positions, r.actual[:, :2], r.path) if p is not None]
    every = np.concatenate(points)
    return np.nanmin(every, axis=0) - 0.08, np.nanmax(every, axis=0) + 0.08


def travelled(record: WalkRecord) -> float:
    """[m] between the first and the last finite place of the COM."""
    places = record.com[np.isfinite(record.com).all(axis=1), :2]
    return float(np.linalg.norm(places[-1] - places[0])) if len(places) else float("nan")
