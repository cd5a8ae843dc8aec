"""A report's figures as pictures: a bar a contender, its quartiles as a whisker, a panel a group."""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt

from benchmarks.suite.figures import Group, Result, quartiles
from benchmarks.suite.report import Report
from iwalker_jax.runtime.files import atomic_write

_OURS, _PEER = "#1f6f8b", "#b8b8b8"
_MOST = 6
"""Panels of one picture; a benchmark on many sizes of one problem shows its first ones."""


def picture_names(report: Report, stem: str) -> dict[str, str]:
    """File name by benchmark, of those that compare contenders."""
    return {name: f"{stem}_{name}.png" for name, result in report.results.items() if compared(result)}


def compared(result: Result) -> list[Group]:
    """The groups with a peer, as many as a picture holds."""
    return [group for group in result.groups if group.fastest_peer() is not None][:_MOST]


def draw(report: Report, folder: Path, names: dict[str, str]) -> None:
    """Write the pictures; OSError as `atomic_write`."""
    for name, file in names.items():
        groups = compared(report.results[name])
        heights = [len(group.rows) + 1.5 for group in groups]
        figure, axes = plt.subplots(
            len(groups), 1, figsize=(8, 0.3 * sum(heights) + 0.5), height_ratios=heights, squeeze=False
        )
        for axis, group in zip(axes[:, 0], groups, strict=True):
            _panel(axis, group)
        figure.tight_layout()
        with atomic_write(folder / file) as part:
            figure.savefig(part, dpi=90, metadata={"Software": None})
        plt.close(figure)


def _panel(axis: plt.Axes, group: Group) -> None:
    rows = sorted(group.rows, key=lambda row: row.median, reverse=True)
    medians = [1e6 * row.median for row in rows]
    ends = [[1e6 * end for end in quartiles(row.turns)] for row in rows]
    errors = [[m - low for m, (low, _) in zip(medians, ends)], [high - m for m, (_, high) in zip(medians, ends)]]
    colours = [_OURS if row.kind == "ours" else _PEER for row in rows]
    axis.barh([row.name for row in rows], medians, color=colours, xerr=errors, ecolor="#444444", capsize=2)
    axis.set_xscale("log")
    axis.set_title(group.title, fontsize=9, loc="left")
    axis.set_xlabel(f"us {group.item}, median and quartiles", fontsize=8)
    axis.tick_params(labelsize=8)
