"""Picture sheets of recorded walks: traces and footsteps from above, speeds, posture, torques, contacts and errors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure
from iwalker_jax.evaluation.walks.traces import draw_from_above, ground_extent, travelled
from iwalker_jax.geometry import Side
from iwalker_jax.walking import WalkRecord

_FEET = ("right", "left")
_DETAIL = 2.0
"""[s] shown of torques and forces, about the largest share of a motor's limit."""

_MOTORS = (
    *(f"{name} {side}" for side in "rl" for name in ("yaw", "hip A", "hip B", "knee", "ankle")),
    *(f"{name} {side}" for side in "rl" for name in ("sh. pitch", "sh. roll", "elbow")),
)


def save_walk_sheet(record: WalkRecord, file: Path, title: str = "") -> None:
    """Write a PNG that shows one robot's walk.

    Args:
        record: the walk.
        file: PNG to write; its folder is created.
        title: stands before a line of figures.

    Raises:
        InputError: a file that cannot be written.
    """
    low, high = ground_extent([record])
    ground = float(np.clip(14.0 * (high[1] - low[1]) / (high[0] - low[0]), 2.0, 6.0)) + 0.8
    figure = pyplot().figure(figsize=(15.0, 10.0 + ground), layout="constrained")
    grid = figure.add_gridspec(4, 3, height_ratios=(ground, 10 / 3, 10 / 3, 10 / 3))
    above = figure.add_subplot(grid[0, :])
    draw_from_above(above, record, low, high)
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8, ncols=6)
    timed = [[figure.add_subplot(grid[row, column]) for column in range(3)] for row in (1, 2, 3)]
    _speed(timed[0][0], record)
    _posture(timed[0][1], record)
    _height(timed[0][2], record)
    legs = [slice(k * record.leg_motors, (k + 1) * record.leg_motors) for k in range(2)]
    for axis, leg, foot in zip(timed[1], legs, _FEET):
        _torques(axis, record, leg, foot)
    _peak_torques(timed[1][2], record)
    _forces(timed[2][0], record)
    _friction(timed[2][1], record)
    _footstep_errors(timed[2][2], record)
    detail, whole = _detail(record), (record.time[0], record.time[-1])
    for axis in (*timed[0], *timed[1][:2], *timed[2][:2]):
        axis.set_xlabel("time [s]", fontsize=8)
        axis.set_xlim(*(detail if axis in (*timed[1][:2], timed[2][0]) else whole))
        for push in record.push_times:
            axis.axvline(push, color="tab:red", linestyle=":", linewidth=1.2)
    for axis in (above, *(axis for row in timed for axis in row)):
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.25)
    figure.suptitle(": ".join(part for part in (title, _figures(record)) if part))
    save_figure(figure, file)


def _figures(record: WalkRecord) -> str:
    duration = record.time[-1] - record.time[0]
    text = f"{travelled(record):.2f} m in {duration:.1f} s"
    errors = record.footstep_errors()
    made = np.isfinite(errors)
    if made.any():
        text += (
            f"; {made.sum()} of {len(errors)} footsteps made, error mean {100 * errors[made].mean():.1f} cm, "
            f"max {100 * errors[made].max():.1f} cm"
        )
    return text + f"; peak torque {100 * np.nanmax(np.abs(record.torques) / record.torque_limits):.0f} % of the limit"


def _detail(record: WalkRecord) -> tuple[float, float]:
    """Begin and end [s] of what is shown of torques and forces."""
    share = np.nan_to_num(np.abs(record.torques) / record.torque_limits).max(axis=1)
    begin = record.time[np.argmax(share)] - 0.5 * _DETAIL
    begin = max(min(begin, record.time[-1] - _DETAIL), record.time[0])
    return begin, min(begin + _DETAIL, record.time[-1])


def _stride_mean(record: WalkRecord, values: np.ndarray) -> np.ndarray:
    """Mean over one stride (two steps), which takes out the sway; NaN within half a stride of the ends."""
    periods = np.diff(record.planned.times)
    stride = 2.0 * float(np.median(periods)) if len(periods) else 0.5
    half = min(round(stride / 2 / float(np.median(np.diff(record.time)))), (len(values) - 1) // 2)
    window = 2 * half + 1
    mean = np.full(len(values), np.nan)
    mean[half : len(values) - half] = np.convolve(values, np.full(window, 1.0 / window), mode="valid")
    return mean


def _speed(axis: Axes, record: WalkRecord) -> None:
    speeds = record.speeds_along_heading(record.com_velocity)
    if record.estimated_velocity is not None:
        estimate = record.speeds_along_heading(record.estimated_velocity)[:, 0]
        axis.plot(record.time, estimate, color="tab:purple", linewidth=0.6, alpha=0.5, label="estimated")
    for column, name, colour in ((1, "leftward", "tab:green"), (0, "forward", "tab:red")):
        axis.plot(record.time, speeds[:, column], color=colour, linewidth=0.5, alpha=0.4)
        mean = _stride_mean(record, speeds[:, column])
        axis.plot(record.time, mean, color=colour, linewidth=1.6, label=f"{name}, stride mean")
    if record.commanded_speed is not None:
        axis.plot(record.time, record.commanded_speed, "k--", linewidth=1.2, label="commanded")
    axis.set_title("COM speed [m/s]", fontsize=9)
    axis.legend(fontsize=7, ncols=2)


def _posture(axis: Axes, record: WalkRecord) -> None:
    roll, pitch, yaw = np.degrees(record.base_rpy).T
    finite = np.isfinite(yaw)
    yaw[finite] = np.unwrap(yaw[finite], period=360.0)
    for values, name, colour in ((roll, "roll", "tab:green"), (pitch, "pitch", "tab:red"), (yaw, "heading", "black")):
        axis.plot(record.time, values, color=colour, linewidth=1.4 if name == "heading" else 0.7, label=name)
    axis.set_title("base orientation [deg]", fontsize=9)
    axis.legend(fontsize=7)


def _height(axis: Axes, record: WalkRecord) -> None:
    axis.plot(record.time, record.com[:, 2], color="black", linewidth=1.0, label="COM")
    for i, foot in enumerate(_FEET):
        axis.plot(
            record.time, record.foot_positions[:, i, 2], color=FOOT_COLOURS[foot], linewidth=0.9, label=f"{foot} foot"
        )
    axis.set_ylim(bottom=min(0.0, float(np.nanmin(record.foot_positions[..., 2]))) - 0.01)
    axis.set_title("height of COM and feet [m]", fontsize=9)
    axis.legend(fontsize=7, loc="center right")


def _torques(axis: Axes, record: WalkRecord, leg: slice, foot: str) -> None:
    for i in range(*leg.indices(record.torques.shape[1])):
        axis.plot(record.time, record.torques[:, i], linewidth=1.0, label=_motor_names(record)[i])
    signs = (-1.0, 1.0) if np.nanmin(record.torques) < 0.0 else (0.0, 1.0)
    for sign in signs:
        for limit in np.unique(record.torque_limits[leg]):
            axis.axhline(sign * limit, color="black", linestyle="--", linewidth=1.0)
    axis.set_title(f"motor torques about the peak, {foot} leg [N m]", fontsize=9)
    axis.legend(fontsize=7, ncols=5, loc="upper center", handlelength=1.0, columnspacing=0.8)
    axis.set_ylim(*(1.3 * float(np.max(record.torque_limits[leg])) * np.array(signs)))


def _peak_torques(axis: Axes, record: WalkRecord) -> None:
    share = 100.0 * np.abs(record.torques) / record.torque_limits
    names = _motor_names(record)
    places = np.arange(len(names))
    axis.bar(places, np.nanmax(share, axis=0), color="0.75", label="peak")
    axis.bar(places, np.sqrt(np.nanmean(share**2, axis=0)), color="tab:green", width=0.5, label="root mean square")
    axis.axhline(100.0, color="black", linestyle="--", linewidth=1.0)
    axis.set_xticks(places, names, rotation=60, ha="right")
    axis.set_title("motor torques [% of limit]", fontsize=9)
    axis.legend(fontsize=7)


def _motor_names(record: WalkRecord) -> Sequence[str]:
    count = record.torques.shape[1]
    return _MOTORS if count == len(_MOTORS) else [str(i) for i in range(count)]


def _forces(axis: Axes, record: WalkRecord) -> None:
    vertical = record.forces[..., 2].reshape(len(record.time), 2, -1).sum(axis=2)
    for i, foot in enumerate(_FEET):
        axis.plot(record.time, vertical[:, i], color=FOOT_COLOURS[foot], linewidth=1.2, label=f"{foot} foot")
    axis.set_ylim(0.0, 1.25 * max(float(np.nanpercentile(vertical, 99.8)), 1.0))
    axis.set_title("vertical contact force about the peak torque [N]", fontsize=9)
    axis.legend(fontsize=7, loc="upper right")


def _friction(axis: Axes, record: WalkRecord) -> None:
    ratios = record.friction_ratios()
    for i, foot in enumerate(_FEET):
        axis.plot(record.time, ratios[:, i], ".", color=FOOT_COLOURS[foot], markersize=1.5, label=f"{foot} foot")
    if record.friction is not None:
        axis.axhline(record.friction, color="black", linestyle="--", linewidth=1.0, label="floor's friction")
    axis.set_ylim(0.0, 1.25 * max(record.friction or 0.0, *(float(np.nanmax(r, initial=0.1)) for r in ratios.T)))
    axis.set_title("horizontal / vertical contact force", fontsize=9)
    axis.legend(fontsize=7, loc="upper right", markerscale=5)


def _footstep_errors(axis: Axes, record: WalkRecord) -> None:
    errors = 100.0 * record.footstep_errors()
    steps = np.arange(len(errors)) + 1
    for side in Side:
        foot = side.name.lower()
        mine = record.planned.sides == side
        axis.bar(steps[mine], errors[mine], color=FOOT_COLOURS[foot], width=0.8, label=f"{foot} foot")
    missing = ~np.isfinite(errors)
    if missing.any():
        axis.plot(steps[missing], np.zeros(missing.sum()), "x", color="tab:red", label="not made")
    axis.set_xlabel("footstep", fontsize=8)
    axis.set_title("distance of footstep from plan [cm]", fontsize=9)
    if len(errors):
        axis.legend(fontsize=7)
