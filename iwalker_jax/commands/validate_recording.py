"""What is usable in a recording, what is wrong, what was assumed: python -m experiments.validate_recording PLACE."""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.markup import escape
from rich.table import Table

from iwalker_jax.commands.shared.console import console, ends_in_a_sentence, require_counts, require_devices
from iwalker_jax.data import RecordingReport, load_recording, validate_recording
from iwalker_jax.evaluation.rerun_files import require_rerun, write_recording
from iwalker_jax.perception import Intrinsics
from iwalker_jax.runtime import printable


@dataclass(frozen=True)
class Command:
    """Say what is usable in a recording of depth images, what is wrong, file by file, and what was assumed.

    Attributes:
        folder: of the recording: recording.yaml, TUM RGB-D or iPlanner layout, or bare PNG or .npy images with
            --intrinsics; or a bag of ROS 1 (.bag) or ROS 2.
        intrinsics: width height fx fy cx cy [px] of the stored images; wins over the folder's own.
        depth_scale: [m] per unit of the images; wins over the folder's own.
        topic: of the depth images in a bag that has several.
        max_problems: problems to print.
        rerun: file (.rrd) to write for the viewer rerun: the usable frames as images and points.
    """

    folder: Annotated[Path, tyro.conf.Positional]
    intrinsics: tuple[int, int, float, float, float, float] | None = None
    depth_scale: float | None = None
    topic: str | None = None
    max_problems: int = 40
    rerun: Path | None = None


@ends_in_a_sentence()
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status, 0 if at least one frame is usable."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    require_counts(command, max_problems=0)
    require_devices()
    if command.rerun is not None:
        require_rerun(command.rerun)
    intrinsics = None if command.intrinsics is None else Intrinsics(*command.intrinsics)
    report = validate_recording(command.folder, intrinsics, command.depth_scale, command.topic)
    print_report(report, command.max_problems)
    if command.rerun is not None and report.is_usable:
        write_recording(
            command.rerun, load_recording(command.folder, intrinsics, command.depth_scale, topic=command.topic)
        )
    return 0 if report.is_usable else 1


def print_report(report: RecordingReport, max_problems: int) -> None:
    """Print a summary, at most so many problems, and what was assumed."""
    summary = Table(show_header=False, title=f"Recording {escape(printable(report.folder, 300))}")
    summary.add_row("layout", report.layout)
    summary.add_row("frames", f"{len(report.usable)} usable of {report.found}")
    if report.intrinsics is not None:
        K = report.intrinsics
        summary.add_row("intrinsics", f"{K.width} x {K.height} px, f {K.fx:g} {K.fy:g}, c {K.cx:g} {K.cy:g}")
        summary.add_row("depth scale", f"{report.depth_scale:g} m per unit")
    if report.mount is not None:
        height, pitch, roll, forward, left = report.mount
        summary.add_row(
            "mount (median)",
            f"height {height:.3f} m, pitch {math.degrees(pitch):.1f}°, roll {math.degrees(roll):.1f}°, "
            f"forward {forward:.3f} m, left {left:.3f} m",
        )
    console.print(summary)
    if report.topics:
        topics = Table("topic", "type", "messages", "use", title=f"{len(report.topics)} topics")
        for topic in report.topics:
            topics.add_row(escape(printable(topic.name)), topic.type, str(topic.messages), escape(topic.use))
        console.print(topics)
    if report.problems:
        problems = Table("file", "problem", title=f"{len(report.problems)} problems")
        for problem in report.problems[:max_problems]:
            problems.add_row(escape(problem.file), escape(problem.problem))
        console.print(problems)
        if len(report.problems) > max_problems:
            console.print(f"... and {len(report.problems) - max_problems} more (--max-problems)")
    for assumption in report.assumptions:
        console.print(f"[yellow]assumed:[/yellow] {escape(assumption)}")
    if report.fatal is not None:
        console.print(f"[red]unusable:[/red] {escape(report.fatal)}")
    else:
        console.print("[green]usable[/green]")
