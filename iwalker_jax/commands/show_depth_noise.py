"""Simulated depth beside a real camera's: python -m experiments.show_depth_noise [--real FOLDER]."""

import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import cv2
import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import tyro
from rich.table import Table

from iwalker_jax.commands.shared.console import console, ends_in_a_sentence, require_devices, say
from iwalker_jax.data.recordings import depth_images, read_depth_png
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation import pyplot, save_figure
from iwalker_jax.perception import CameraMount, Intrinsics
from iwalker_jax.perception.depth_png import png_size
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.scenes import (
    DepthNoise,
    add_depth_noise,
    generate_scene,
    obstacle_distance,
    render_depth,
    world_camera_pose,
)
from iwalker_jax.streams import check_seed

RANGES = ((0.5, 1.0), (1.0, 2.0), (2.0, 3.0), (3.0, 5.0))
"""[m] bins of the temporal standard deviation."""


@dataclass(frozen=True)
class Command:
    """Show simulated depth images beside ideal ones and a real camera's, and print what their noise is like.

    Attributes:
        real: folder of 16-bit PNG depth images in millimetres, in order; without it only simulated frames are shown.
        output: PNG to write.
        families: scene families to show.
        seed: of scenes, poses and noise.
    """

    real: Path | None = None
    output: Path = Path("depth_noise.png")
    families: tuple[str, ...] = ("open_office", "corridor_doors", "kitchen", "warehouse")
    seed: int = 0


class FrameStatistics(NamedTuple):
    """What tells one depth sensor from another, measured on successive frames of a static view.

    Attributes:
        std_median, std_p95: [m] temporal standard deviation of always-valid pixels in each of `RANGES`; NaN where
            they are less than 1 % of the image.
        flicker: fraction of pixels that turn valid or invalid from one frame to the next.
        invalid: fraction of pixels without a return.
        holes: number of connected invalid regions of at least 5 px of a 640 px wide image (1 px of smaller ones).
        beyond_10m: fraction of pixels with a depth above 10 m.
    """

    std_median: tuple[float, ...]
    std_p95: tuple[float, ...]
    flicker: float
    invalid: float
    holes: float
    beyond_10m: float


def frame_statistics(frames: np.ndarray) -> FrameStatistics:
    """Statistics of (N, height, width) depth [m] of a static view, N >= 2; 0 = no return."""
    valid = frames > 0
    always = valid.all(axis=0)
    mean, std = frames.mean(axis=0), frames.std(axis=0, ddof=1)
    groups = [std[always & (mean >= low) & (mean < high)] for low, high in RANGES]
    groups = [group if group.size >= 0.01 * mean.size else np.array([np.nan]) for group in groups]
    smallest = max(1.0, 5.0 * (frames.shape[2] / 640.0) ** 2)
    holes = [
        np.sum(
            cv2.connectedComponentsWithStats((~v).astype(np.uint8), connectivity=4)[2][1:, cv2.CC_STAT_AREA] >= smallest
        )
        for v in valid
    ]
    return FrameStatistics(
        std_median=tuple(float(np.median(g)) for g in groups),
        std_p95=tuple(float(np.percentile(g, 95)) for g in groups),
        flicker=float(np.mean(valid[1:] != valid[:-1])),
        invalid=float(np.mean(~valid)),
        holes=float(np.mean(holes)),
        beyond_10m=float(np.mean(frames > 10.0)),
    )


def quietest_stretch(frames: np.ndarray, length: int = 4) -> np.ndarray:
    """The `length` successive frames between which the scene nearer than 2 m moves least."""
    change = []
    for first, second in itertools.pairwise(frames):
        near = (first > 0) & (first < 2.0) & (second > 0)
        change.append(np.mean(np.abs(second - first)[near]) if near.any() else np.inf)
    moved = np.convolve(change, np.ones(length - 1), mode="valid")
    start = int(np.argmin(moved))
    return frames[start : start + length]


@ends_in_a_sentence()
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    require_devices()
    check_seed(command.seed, "the scenes")
    require_writable(command.output, is_file=True)
    show_depth_noise(command)
    return 0


def show_depth_noise(command: Command) -> None:
    """Measure, print and draw."""
    real = None if command.real is None else _read_millimetres(command.real)
    ideal, simulated = _simulated_views(command)
    rows = [("ideal", ideal), ("simulated", simulated[:, 0])]
    statistics = {"simulated": _average([frame_statistics(view) for view in simulated])}
    if real is not None:
        shown = np.linspace(0, len(real) - 1, len(ideal)).astype(int)
        rows.append(("real", real[shown]))
        statistics["real, quietest 4 frames"] = frame_statistics(quietest_stretch(real))
    console.print(_table(statistics))

    figure, axes = pyplot().subplots(
        len(rows), len(ideal), figsize=(4.0 * len(ideal), 2.6 * len(rows)), squeeze=False, layout="constrained"
    )
    colours = matplotlib.colormaps["viridis"].copy()
    colours.set_bad("white")
    for line, (name, images) in zip(axes, rows):
        for axis, image in zip(line, images):
            drawn = axis.imshow(np.ma.masked_less_equal(image, 0.0), cmap=colours, vmin=0.0, vmax=6.0)
            axis.set(xticks=[], yticks=[])
        line[0].set_ylabel(name)
    figure.colorbar(drawn, ax=axes, label="depth [m], white = no return", shrink=0.7)
    save_figure(figure, command.output, dpi=90)
    say(f"Picture: {command.output}")


def _simulated_views(command: Command) -> tuple[np.ndarray, np.ndarray]:
    """Ideal frames (views, height, width) and noisy ones (views, 4, height, width), 320 x 180 px."""
    intrinsics, noise = Intrinsics(320, 180, 160.0, 160.0, 159.5, 89.5), DepthNoise()
    mount = CameraMount(pitch=0.3, roll=0.1).as_array()
    rng = np.random.default_rng(command.seed)
    render = jax.jit(lambda scene, pose: render_depth(scene, intrinsics, *world_camera_pose(pose, mount)))
    add = jax.jit(
        jax.vmap(
            lambda key, depth, surface: add_depth_noise(key, depth, noise, intrinsics, surface), in_axes=(0, None, None)
        )
    )
    ideal, simulated = [], []
    for index, family in enumerate(command.families):
        scene = generate_scene(family, command.seed).arrays()
        low, high = np.asarray(scene.bounds[:2]), np.asarray(scene.bounds[2:])
        poses = np.concatenate([rng.uniform(low, high, (200, 2)), rng.uniform(-np.pi, np.pi, (200, 1))], axis=1)
        # One metre free around and before the robot, so that the view is neither a wall nor empty.
        ahead = poses[:, :2] + np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
        room = np.minimum(
            obstacle_distance(scene, jnp.asarray(poses[:, :2])), obstacle_distance(scene, jnp.asarray(ahead))
        )
        depth = render(scene, jnp.asarray(poses[np.argmax(np.asarray(room) > 0.4)]))
        ideal.append(np.asarray(depth))
        key_frames, key_surface = jax.random.split(jax.random.key(command.seed + index))
        simulated.append(np.asarray(add(jax.random.split(key_frames, 4), depth, key_surface)))
    return np.stack(ideal), np.stack(simulated)


def _read_millimetres(folder: Path) -> np.ndarray:
    """(N, height, width) depth [m] of a folder's PNG files, every second pixel."""
    files, _ = depth_images(folder)
    if len(files) < 4:
        raise InputError(f"{folder} needs at least 4 PNG depth images but holds {len(files)}; check the folder.")
    images = []
    for file in files:
        try:
            images.append(read_depth_png(file, 0.001, png_size(files[0]))[::2, ::2])
        except InputError as error:
            raise InputError(f"{file} {error}") from None
    return np.stack(images)


def _average(statistics: list[FrameStatistics]) -> FrameStatistics:
    """Mean over views, leaving out ranges that a view does not show."""
    return FrameStatistics(
        *(np.nanmean(np.array(column, float), axis=0) for column in zip(*statistics)),
    )


def _table(statistics: dict[str, FrameStatistics]) -> Table:
    """Rich table with one column a source."""
    table = Table("figure", *statistics, title="Depth noise of successive frames of a static view")
    for k, (low, high) in enumerate(RANGES):
        cells = [f"{1e3 * s.std_median[k]:.0f} / {1e3 * s.std_p95[k]:.0f} mm" for s in statistics.values()]
        table.add_row(f"temporal std {low:g}-{high:g} m, median / p95", *cells)
    for name in ("flicker", "invalid", "beyond_10m"):
        table.add_row(name, *(f"{100 * getattr(s, name):.1f} %" for s in statistics.values()))
    table.add_row("holes a frame", *(f"{s.holes:.0f}" for s in statistics.values()))
    return table
