"""BRUCE walks in simulation on C MuJoCo: python examples/walk.py [--speed 0.3] [--distance 2] [--out FOLDER].

The whole stack below the planner: footstep plan, gait, stepping feedback, whole-body QP, torques, contacts.
"""

from pathlib import Path

import iwalker_jax as iw

iw.configure_runtime()

import numpy as np
import tyro

from iwalker_jax.evaluation.walks import save_walk_sheet
from iwalker_jax.walking import Sensors


def main(
    speed: float = 0.2, distance: float = 1.0, sensors: Sensors = "nominal", out: Path = Path("runs/examples")
) -> None:
    """Walk straight on the state estimated from simulated sensors, and draw what happened.

    Args:
        speed: [m/s] forward.
        distance: [m] to walk.
        sensors: `none` feeds the true state back; `nominal` and `harsh` are estimated from.
        out: folder to write to.
    """
    motion = iw.Motion("straight", speed=speed, distance=distance)
    result = iw.walk(motion, engine="mujoco", sensors=sensors)
    metrics = result.metrics[0]
    print(f"{metrics.steps} of {metrics.planned} footsteps in {metrics.seconds:.1f} s, fallen: {metrics.fallen}")
    print(f"Speed {metrics.speed:.3f} m/s of {metrics.planned_speed:.3f} m/s planned")
    print(f"Footstep error {100 * np.mean(metrics.footstep_errors):.2f} cm on average")
    print(f"Torque peak {100 * metrics.torque_shares.max():.0f} % of a motor's limit")
    save_walk_sheet(result.records[0], out / "walk_sheet.png", f"straight at {speed:g} m/s")
    print(f"The picture is {out / 'walk_sheet.png'}.")


if __name__ == "__main__":
    tyro.cli(main)
