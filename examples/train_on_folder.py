"""Train a planner on a folder of depth images, and plan with it: python examples/train_on_folder.py [--folder FOLDER].

A folder of 16-bit PNGs is all it takes: the floor is fitted in every image, and goals are drawn where the image itself
shows free ground. Without a folder of your own, views of generated scenes are rendered and written as one.
"""

import dataclasses
from pathlib import Path

import iwalker_jax as iw

iw.configure_runtime()

import tyro

from iwalker_jax.data import frames_from_recording, generate_training_frames
from iwalker_jax.planning import IPathConfig, PlannerConfig
from iwalker_jax.training import TrainConfig, prepare, train


def write_views(folder: Path, count: int) -> Path:
    """A folder of rendered depth images, named in order."""
    for k, depth in enumerate(generate_training_frames(count, families=("lobby", "open_office")).depth_metres()):
        iw.write_depth(folder / f"{k:06d}.png", depth)
    return folder


def main(folder: Path | None = None, images: int = 24, epochs: int = 2, out: Path = Path("runs/examples")) -> None:
    """Train small networks for a few steps; `python -m experiments.train --data FOLDER` trains real ones.

    Args:
        folder: of 16-bit PNGs through the planner's camera (160 x 90 px, focal length 80 px), in millimetres.
        images: rendered where no folder is given.
        epochs: passes over the images.
        out: folder to write to.
    """
    folder = folder or write_views(out / "recording", images)
    frames = frames_from_recording(folder, intrinsics=iw.Intrinsics(), depth_scale=0.001)
    networks = PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=32))
    config = dataclasses.replace(TrainConfig(), planner=networks, epochs=epochs, batch_size=8)
    data = prepare(frames, config.models.traversal)
    losses = []
    train(config, data, out / "run", resume=False, on_progress=lambda step: losses.append(step.losses["total"]))
    print(f"{len(frames)} images, {len(losses)} steps: loss {losses[0]:.3f} at first, {losses[-1]:.3f} at last")
    plan = iw.load_planner(out / "run")(frames.depth_metres()[0], frames.goals[0, 0])
    print(f"The trained planner's first footstep: {plan.footsteps[0].tolist()} m")


if __name__ == "__main__":
    tyro.cli(main)
