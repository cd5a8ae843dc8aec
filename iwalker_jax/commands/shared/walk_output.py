"""What `walk` leaves behind: printed figures, summary, records, pictures and video."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from iwalker_jax.commands.shared.console import say
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.walks import WalkMetrics, save_trace_grid, save_walk_sheet, speed_error, summarise
from iwalker_jax.film import Ending, Overlays, play_motion, write_video
from iwalker_jax.navigation import Outcome
from iwalker_jax.runtime import write_json, write_npz
from iwalker_jax.walking import BatchResult, Conditions, Walk, WalkRecord

_ERRORS = (("footstep", "Footstep error", "cm"), ("COM", "COM error", "cm"), ("heading", "Heading error", "deg"))


def print_figures(metrics: Sequence[WalkMetrics], result: BatchResult) -> dict[str, float]:
    """Print the figures of all robots and return them by column title."""
    row = summarise(metrics)
    off = f"off by {row['speed error %']:.1f} %"
    rates = np.array([(m.turn_rate, m.planned_turn_rate) for m in metrics if m.on_the_spot])
    speeds = [m.planned_speed for m in metrics if m.planned_speed > 1e-3]
    if len(rates):
        turn, planned = np.degrees(rates).mean(axis=0)
        say(f"Turn rate        {turn:.1f} deg/s of {planned:.1f} deg/s planned, {off}")
    elif speeds:
        say(f"Speed            {row['speed m/s']:.3f} m/s of {np.mean(speeds):.3f} m/s planned, {off}")
    if np.isfinite(row["steps made %"]):
        say(f"Footsteps        {row['steps made %']:.1f} % of those planned were made")
    for name, title, unit in _ERRORS:
        mean, largest = row[f"{name} mean {unit}"], row[f"{name} max {unit}"]
        if np.isfinite(mean):
            say(f"{title:16} mean {mean:.2f} {unit}, max {largest:.2f} {unit}")
    failures = row["QP failures"]
    say(f"Torque peak      {row['torque peak %']:.0f} % of a motor's limit")
    say(f"Whole-body QP    {failures:.0f} ticks not converged")
    if row["velocity RMS cm/s"] > 0.01:
        say(f"COM velocity     estimated to {row['velocity RMS cm/s']:.2f} cm/s RMS")
    say(f"Falls            {row['falls']:.0f} of {len(metrics)}")
    began = f"; {result.compile_seconds:.0f} s more to compile and start" if result.compile_seconds else ""
    rate = result.robot_seconds_per_second
    say(f"Simulation       {rate:.1f} robot-seconds a second{began or ', compilation included'}")
    return row


def save_figures(
    folder: Path,
    options: dict[str, Any],
    walk: Walk,
    conditions: Conditions,
    metrics: Sequence[WalkMetrics],
    row: dict[str, float],
    result: BatchResult,
) -> None:
    """Write summary.json, and samples.npz with records, plan and conditions."""
    robots = [
        {
            "fallen": m.fallen,
            "seconds": m.seconds,
            "steps": m.steps,
            "planned": m.planned,
            "speed error %": finite_or_none(speed_error(m)),
        }
        for m in metrics
    ]
    summary = {
        "options": {k: str(v) if isinstance(v, Path) else v for k, v in options.items()},
        "commanded speed m/s": walk.speed,
        "figures": {name: finite_or_none(value) for name, value in row.items()},
        "robots": robots,
        "compile seconds": result.compile_seconds,
        "run seconds": result.seconds,
        "robot-seconds a second": result.robot_seconds_per_second,
    }
    write_json(folder / "summary.json", summary)
    drawn = {f"conditions_{name}": value for name, value in conditions._asdict().items() if name != "key"}
    plan = {f"plan_{name}": value for name, value in walk.plan._asdict().items()}
    write_npz(folder / "samples.npz", result.sample._asdict() | plan | drawn)


def finite_or_none(value: float) -> float | None:
    """A number as JSON can hold it."""
    return value if np.isfinite(value) else None


def save_pictures(folder: Path, records: Sequence[WalkRecord], title: str) -> None:
    """The first robot's sheet walk.png, and traces.png of several robots."""
    save_walk_sheet(records[0], folder / "walk.png", title)
    if len(records) > 1:
        save_trace_grid(records, folder / "traces.png")


def film(
    file: Path | None,
    view: bool,
    model: mujoco.MjModel,
    record: WalkRecord,
    qpos: np.ndarray,
    pushes: np.ndarray,
    fell: bool,
) -> None:
    """A walk as a video, if a file is given, and in the viewer, if asked for.

    A machine that cannot draw is told what is missing and keeps its other results.
    """
    fine = np.isfinite(qpos).all(axis=1)
    end = len(fine) if fine.all() else int(np.argmin(fine))
    if end < 2:
        say("The robot broke at once; there is nothing to film.")
        return
    overlays = Overlays(record.planned if len(record.planned.times) else None, record.forces[:end], pushes[:end])
    outcome = Outcome.FELL if fell else Outcome.REACHED
    words = f"{'Fell' if fell else 'On its feet at the end'}, {record.time[end - 1]:.1f} s"
    overlays = overlays._replace(legend=True, ending=Ending(words, outcome.rgb))
    if file is not None:
        try:
            write_video(file, model, qpos[:end], record.time[:end], overlays=overlays)
        except InputError as error:
            say(f"No video: {error}")
    if view:
        play_motion(model, qpos[:end], record.time[:end], overlays)


def push_forces(conditions: Conditions, robot: int, times: np.ndarray) -> np.ndarray:
    """(N, 3) [N] force on one robot's torso at given times [s]."""
    since = times - float(conditions.push_start[robot])
    during = (since >= 0) & (since < float(conditions.push_time[robot]))
    return during[:, None] * np.asarray(conditions.push_force[robot])
