"""One depth image to a path and footsteps, drawn: python examples/plan_from_depth.py [--file DEPTH.png --goal 3 0.5].

Without a file of your own, the view into the demonstration office is rendered and written as a 16-bit PNG first.
"""

from dataclasses import dataclass
from pathlib import Path

import iwalker_jax as iw

iw.configure_runtime()

import jax.numpy as jnp
import tyro

from iwalker_jax.scenes import render_depth, world_camera_pose
from iwalker_jax.tasks import named_task


@dataclass(frozen=True)
class Command:
    """Plan from one depth image.

    Attributes:
        file: 16-bit PNG of your own, 160 x 90 px with a focal length of 80 px (give `read_depth` other intrinsics).
        depth_scale: [m] per unit of the file.
        goal: x, y [m] ahead and to the left of the robot.
        out: folder to write to.
    """

    file: Path | None = None
    depth_scale: float = 0.001
    goal: tuple[float, float] = (3.1, 0.0)
    out: Path = Path("runs/examples")


def render_office(file: Path) -> Path:
    """What BRUCE's camera sees where the office demonstration begins, as a depth file."""
    task = named_task("office")
    camera = world_camera_pose(jnp.asarray(task.start), iw.CameraMount().as_array())
    iw.write_depth(file, render_depth(task.scene.arrays(), iw.Intrinsics(), *camera))
    return file


def main(command: Command) -> None:
    file = command.file or render_office(command.out / "depth.png")
    depth = iw.read_depth(file, depth_scale=command.depth_scale)
    plan = iw.load_planner()(depth, command.goal)
    print(f"The path is {float(jnp.linalg.norm(jnp.diff(plan.path, axis=0), axis=1).sum()):.2f} m long.")
    for k, (x, y) in enumerate(plan.footsteps[:4].tolist()):
        side = ("right", "left")[(int(plan.first_swing) + k) % 2]
        print(f"Footstep {k + 1} ({side}): {x:.2f} m ahead, {y:+.2f} m to the left")
    iw.draw_plan(depth, plan, command.out / "plan.png", goal=command.goal)
    print(f"The picture is {command.out / 'plan.png'}.")


if __name__ == "__main__":
    main(tyro.cli(Command))
