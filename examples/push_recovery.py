"""Sixteen robots at once, each pushed while it walks: python examples/push_recovery.py [--impulse 1.5] [--out FOLDER].

One compiled MJX program walks all of them; friction, mass, start and the push's sign and time are drawn for each.
"""

from pathlib import Path
from typing import Literal

import iwalker_jax as iw

iw.configure_runtime()

import numpy as np
import tyro

from iwalker_jax.evaluation.walks import save_trace_grid


def main(
    robots: int = 16,
    impulse: float = 1.5,
    axis: Literal["x", "y"] = "y",
    seconds: float = 4.0,
    out: Path = Path("runs/examples"),
) -> None:
    """Walk in place and be pushed.

    Args:
        robots: at once.
        impulse: [N s] of a push of 0.1 s on the torso.
        axis: of the world, x or y.
        seconds: [s] of stepping; the push comes after a third of them.
        out: folder to write to.
    """
    pushes = iw.Disturbances(push_impulse=impulse, push_axis=axis, push_after=seconds / 3)
    result = iw.walk(iw.Motion("in_place", seconds=seconds), robots, disturbances=pushes)
    fallen = [metrics.fallen for metrics in result.metrics]
    offsets = [np.abs(record.com[:, "xy".index(axis)]).max() for record in result.records]
    print(f"{robots - sum(fallen)} of {robots} robots kept their feet after a push of {impulse:g} N s along {axis}.")
    print(f"The pushes moved the COM by up to {100 * max(offsets):.0f} cm.")
    print(f"{result.batch.robot_seconds_per_second:.1f} robot-seconds a second, compilation left out")
    save_trace_grid(result.records, out / "pushes.png")
    print(f"The picture is {out / 'pushes.png'}.")


if __name__ == "__main__":
    tyro.cli(main)
