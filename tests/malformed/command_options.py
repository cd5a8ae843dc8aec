"""Broken options of every command: refused in a sentence, before any long work, and nothing written.

One option of a call that is fine is broken; a call that is not refused begins its work, and then takes too long.
"""

import contextlib
import importlib
import io
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from iwalker_jax.training import PRESETS
from iwalker_jax.walking import Disturbances
from tests.malformed.kinds import HangError, Kind
from tests.malformed.odd_files import odd_place, unwritable_folder
from tests.malformed.option_values import COUNTS, NAMES, SECONDS, SEEDS, SWITCHES, impossible_values, leaves

Values = Callable[[np.random.Generator, Path], tuple[str, str]]
"""Makes a broken value of an option: (what is wrong with it, the value)."""


def one_of(*groups: tuple[str, ...]) -> Values:
    """Any of some values."""
    values = [value for group in groups for value in group]
    return lambda rng, folder: (repr(short := str(rng.choice(values)))[:60], short)


def no_file(suffix: str) -> Values:
    """A place without a usable file of that ending."""
    return lambda rng, folder: odd_place(rng, folder, suffix)


def no_options(rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """A place without a file of options, or one whose options are none of a command's or of another type."""
    texts = ("", "[1]", "{", '{"colour": 1}', '{"seed": "x"}', '{"seed": true}', '{"seed": [[0]]}', '{"seed": null}')
    kind = rng.integers(len(texts) + 1)
    if kind == len(texts):
        return odd_place(rng, folder, ".json")
    (folder / "options.json").write_text(texts[kind])
    return f"options {texts[kind]}", str(folder / "options.json")


def no_rerun_file(rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """A place where no file of rerun can be, or one of another ending."""
    kind, place = unwritable_folder(rng, folder)
    return (kind, f"{place}/file.rrd") if rng.random() < 0.7 else ("another ending", str(folder / "file.png"))


def no_run(rng: np.random.Generator, folder: Path) -> tuple[str, str]:
    """A place that is no run, or one without a checkpoint."""
    kind = rng.integers(3)
    if kind == 0:
        return odd_place(rng, folder)
    run = folder / "run"
    (run / "checkpoints" / ("5" if kind == 2 else "")).mkdir(parents=True)
    return ("empty checkpoints", "an empty checkpoint")[kind - 1], str(run)


COUNT, NONE_TOO, SEED, NAME = one_of(COUNTS, ("0",)), one_of(COUNTS), one_of(SEEDS), one_of(NAMES)
LISTED = one_of(tuple(name for name in NAMES if name.strip() == name))  # a list may hold spaces
TIME, SWITCH, FOLDER, RECORDING, RUN = one_of(SECONDS), one_of(SWITCHES), unwritable_folder, no_file(""), no_run
CONFIG, RRD = no_options, no_rerun_file
DEVICES = one_of(COUNTS, ("0", "4096"))
GROUP: dict[str, Values] = {
    "--coordinator": one_of(("", "x", "host:", ":1", "host:0", "host:99999999", "a\0b:80")),
    "--processes": NONE_TOO,
    "--process": NONE_TOO,
}
SHIFTS: dict[str, Values] = {
    option: one_of(impossible_values(value))
    for option, value in leaves(Disturbances())
    if isinstance(value, float) and option != "--push-after"
}


@dataclass(frozen=True)
class Called:
    """How a command is called.

    Attributes:
        options: what may be broken, and how.
        fine: options of a call that would begin its work, as text split at spaces.
        contradictions: options that are fine by themselves but not together.
    """

    options: dict[str, Values]
    fine: str = ""
    contradictions: tuple[str, ...] = ()


STUDY = Called(
    {"--out": FOLDER, "--seeds": COUNT, "--epochs": COUNT, "--frames": COUNT, "--unseen-scenes": NONE_TOO},
    "--frames 500",
)
SETTINGS = {name: list(leaves(make())) for name, make in PRESETS.items()}

CALLED: dict[str, Called] = {
    "train": Called(
        {
            "--preset": NAME, "--config": CONFIG, "--data": RECORDING, "--out": FOLDER, "--start-from": RUN,
            "--devices": DEVICES, "--unseen-scenes": NONE_TOO, "--source.episodes": no_file(".npz"),
            "--batch-size": COUNT, "--seed": SEED, "--source.seed": SEED, "--source.frames": COUNT,
            "--epochs": COUNT, "--gradient": NAME, **GROUP,
        },
        "--source.frames 3000",
        ("--batch-size 4000 --devices 3", "--planner.ipath.camera.width 40 --planner.ipath.camera.cx 3e9"),
    ),
    "collect": Called(
        {
            "--config": CONFIG, "--run": RUN,
            "--out": lambda rng, folder: below(unwritable_folder(rng, folder), "e.npz"), "--tasks": COUNT,
            "--seconds": TIME, "--stride": COUNT, "--policy": NAME, "--width": COUNT, "--devices": DEVICES,
            "--seed": SEED,
        },
    ),
    "export": Called({"--run": RUN, "--out": FOLDER, "--policy": NAME, "--verify": NONE_TOO, "--seed": SEED}),
    "ablation": STUDY,
    "compare": STUDY,
    "evaluate": Called(
        {
            "--config": CONFIG, "--run": RUN, "--out": FOLDER, "--scenes": one_of(NAMES[1:]),
            "--unseen-scenes": NONE_TOO, "--data": RECORDING, "--episodes": NAME,
            "--count": COUNT, "--seeds": COUNT, "--policies": LISTED, "--depth": NAME, "--state": NAME,
            "--width": COUNT, "--devices": DEVICES, "--seed": SEED, "--checkpoint": COUNT, **GROUP,
        },
        "",
        ("--checkpoint 3", "--policies networks@", "--policies networks@/absent", "--policies ,", "--episodes ,",
         "--policies default,default@x", "--processes 2", "--process 1"),
    ),
    "show_depth_noise": Called(
        {"--real": RECORDING, "--seed": SEED, "--families": NAME,
         "--output": lambda rng, folder: below(unwritable_folder(rng, folder), "noise.png")},
    ),
    "validate_recording": Called(
        {"--rerun": RRD, "--max-problems": NONE_TOO, "--depth-scale": TIME,
         "--intrinsics": one_of(("1", "x", "nan", "1e400", "-1"))},
        "absent_recording",
        ("--intrinsics 0 0 1 1 1 1", "--intrinsics 9 9 nan 1 1 1", "--intrinsics 160 90 80 80 79 1e9"),
    ),
    "run_policy": Called(
        {"--goals": one_of(("1", "x", "nan")), "--simulate": NAME, "--seconds": TIME, "--planner": TIME,
         "--camera": TIME, "--seed": SEED},
        "absent_policy",
        ("--goals 1 1 --simulate office", "--goals 1 1 --lockstep", "--goals 1 1 --camera-until 2", "--goals inf 1"),
    ),
    "walk": Called(
        {
            "--motion": NAME, "--speed": one_of(impossible_values(1.0)), "--turn": one_of(impossible_values(1.0)),
            "--distance": TIME, "--seconds": TIME, "--width": TIME, "--footsteps": no_file(".csv"),
            "--path": no_file(".csv"), "--robots": COUNT, "--engine": NAME, "--devices": DEVICES, "--seed": SEED,
            "--sensors": NAME, "--out": FOLDER, "--rerun": RRD, "--view": SWITCH, "--push-axis": NAME, **SHIFTS,
        },
        "",
        ("--footsteps a.csv --path b.csv", "--goals 1 1", "--policy classical", "--motion path", "--view",
         "--friction 1 0.5", "--friction nan 1", "--friction -1 1", "--delay 3 1", "--delay -1 1", "--run r"),
    ),
    "walk --scene office": Called(
        {
            "--policy": NAME, "--run": RUN, "--out": FOLDER, "--seed": SEED, "--sensors": NAME, "--up": NAME,
            "--start": one_of(("1", "x", "nan")), "--goals": one_of(("1", "x", "nan")), **SHIFTS,
        },
        "",
        ("--robots 2", "--engine mujoco", "--bounds 0 0 1 1", "--start nan 0 0", "--start 1e9 0 0", "--goals 1e9 1e9",
         "--goals nan 0", "--goals inf 0", "--start 0 0 inf", "--motion turn", "--goals 1 1 2 2 3 3 4 4 5 5 6 6 7 7"),
    ),
    "walk --scene": Called({"": no_file(".obj"), " ": no_file(".xml"), "  ": NAME}, "--goals 1 1"),
    "walk_study": Called(
        {"--suites": NAME, "--seeds": COUNT, "--trials": COUNT, "--engine": NAME, "--seed": SEED, "--out": FOLDER,
         "--devices": DEVICES},
    ),
    "whole_body_study": Called(
        {"--out": FOLDER, "--epochs": COUNT, "--frames": COUNT, "--tasks": COUNT, "--seed": SEED, "--policy": NAME},
        "--frames 500",
        ("--weights.placement nan", "--weights.tracking -1e30"),
    ),
}  # fmt: skip


def below(place: tuple[str, str], name: str) -> tuple[str, str]:
    """A file in a folder that cannot be."""
    return place[0], f"{place[1]}/{name}"


def broken_call(name: str, rng: np.random.Generator, folder: Path) -> tuple[str, list[str]]:
    """(what is broken, arguments) of a call of a command."""
    called = CALLED[name]
    arguments = [*name.split()[1:], *called.fine.split()]
    if called.contradictions and rng.random() < 0.25:
        clash = str(rng.choice(called.contradictions))
        return clash, [*arguments, *clash.split()]
    options = list(called.options)
    option = options[rng.integers(len(options))]
    what, value = called.options[option](rng, folder)
    if not option.strip():
        return f"scene {what}", [*name.split()[1:], value, *called.fine.split()]
    return f"{option} {what}", [*arguments, f"{option}={value}"]


def broken_setting(rng: np.random.Generator, folder: Path) -> tuple[str, list[str]]:
    """(what is broken, arguments) of a training with one of its settings impossible."""
    preset = str(rng.choice(list(SETTINGS)))
    settings = SETTINGS[preset]
    option, default = settings[rng.integers(len(settings))]
    while default is None:
        option, default = settings[rng.integers(len(settings))]
    what, value = one_of(impossible_values(default))(rng, folder)
    return f"--preset {preset} {option} {what}", ["--preset", preset, "--source.frames=3000", f"{option}={value}"]


@contextlib.contextmanager
def working_folder(folder: Path) -> Iterator[None]:
    """A block with the process in a folder, and the generated frames kept in it."""
    before, cache = Path.cwd(), os.environ.get("IWALKER_CACHE")
    os.chdir(folder)
    os.environ["IWALKER_CACHE"] = str(folder / "cache")
    try:
        yield
    finally:
        os.chdir(before)
        os.environ.pop("IWALKER_CACHE")
        if cache is not None:
            os.environ["IWALKER_CACHE"] = cache


def call(command: str, arguments: list[str]) -> tuple[object, str, str]:
    """(status, stdout, stderr) of a command called in this process."""
    module = importlib.import_module(f"iwalker_jax.commands.{command}")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            status = module.main(arguments)
        except SystemExit as end:
            status = end.code
    return status, out.getvalue(), err.getvalue()


def judge(status: object, out: str, err: str) -> str | None:
    """What is wrong with how a command left that had to refuse its options."""
    if status in (0, None):
        return f"accepted; printed {out[-300:]!r}"
    if "Traceback" in err + out:
        return f"prints a traceback: {err[-300:]!r}"
    if status == 2:  # the parser's own box, of several lines
        return None if err.strip() else "says nothing"
    if "unusable:" in out:
        return None
    lines = err.strip().splitlines()
    if len(lines) != 1 or not lines[0].startswith("error: ") or len(lines[0]) > 1200 or not lines[0].isprintable():
        return f"says {err[:400]!r}"
    return None


def refused(
    call_of: Callable[[np.random.Generator, Path], tuple[str, list[str]]],
    command: str,
    rng: np.random.Generator,
    folder: Path,
) -> str | None:
    """Call a command with something broken; what is wrong with its answer."""
    what, arguments = call_of(rng, folder)
    before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}
    with working_folder(folder):
        try:
            wrong = judge(*call(command, arguments))
        except HangError as error:
            raise HangError(f"{what}: {error}") from error
        except Exception as error:
            raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    after = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}
    if wrong is None and after != before:
        wrong = f"has written {sorted(str(path.relative_to(folder)) for path in {*after} - {*before})[:5]}"
    return wrong and f"{what}: {wrong}"


KINDS: dict[str, Kind] = {
    **{name: partial(refused, partial(broken_call, name), name.split()[0]) for name in CALLED},
    "train_settings": partial(refused, broken_setting, "train"),
}
