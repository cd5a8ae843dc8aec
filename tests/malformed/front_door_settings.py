"""Settings, files and whole jobs by the front door with something in them that cannot be: refused before any work."""

import dataclasses
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import iwalker_jax as iw
from iwalker_jax.walking import make_walk
from tests.malformed.drafts import GOOD_IMAGES
from tests.malformed.kinds import Kind
from tests.malformed.odd_files import odd_place, unwritable_folder
from tests.malformed.saved_files import damaged_bytes
from tests.malformed.sentences import is_no_sentence, refused

NAN, INF = float("nan"), float("inf")

NO_NUMBERS: tuple[Any, ...] = ("x", "", b"1", [1.0], {"a": 1}, 1j, NAN, INF, -INF)
IMPOSSIBLE: dict[type, tuple[Any, ...]] = {
    float: (*NO_NUMBERS, 1e300, -1e30, 10**400),
    int: (*NO_NUMBERS, 1.5, -1_000_000, 10**400),
    tuple: ((NAN, 1.0), (1.0,), (1.0, 2.0, 3.0), "xy", 3.0, (-1.0, 1.0), (2.0, 1.0), ("a", "b"), (-INF, INF), ()),
    str: ("", "unknown", 3, None, b"x"),
}
"""What a setting with a default of some type cannot be, whatever it means."""

SETTINGS = (iw.Intrinsics, iw.CameraMount, iw.GridSpec, iw.HlipParameters, iw.StepMpcWeights, iw.UnicycleParameters,
            iw.Disturbances, iw.Motion, iw.SoftOccupancy)  # fmt: skip

MOTIONS: dict[str, tuple[Any, ...]] = {
    "step_length": (*NO_NUMBERS, 5.0), "distance": (*NO_NUMBERS, -1.0, 0.0, 1e9), "seconds": (*NO_NUMBERS, -1.0, 0.0),
    "file": (Path("absent.csv"), Path("a\0b"), Path("/dev/zero"), 3), "kind": ("path", "footsteps"),
}  # fmt: skip
WALKS: dict[str, tuple[Any, ...]] = {
    "motion": ("fly", "", None, 3, "path", "footsteps", ("straight",)),
    "robots": (0, -1, 10**9, 1.5, "x", None, NAN),
    "sensors": ("all", None, 3, []),
    "engine": ("bullet", None, "", []),
    "solver": ("simplex", "", None, 3, []),
    "seed": (-1, 2**70, 0.5, "x", None),
    "devices": (0, -1, 4096, "x", 1.5),
    "robot": ("unknown", "", None, 3, [], "absent.toml"),
    "disturbances": (None, 3, {"mass": 1}),
    "gait": (3, "fast"),
}
EPISODES: dict[str, tuple[Any, ...]] = {
    "tasks": ("unknown", "", None, 3, [], [3], [None], ["office", "unknown"], {"office": 1}),
    "policy": ("unknown", "", None, 3, []),
    "run": ("absent", Path("a\0b"), "/dev/zero", 3, ""),
    "sensors": WALKS["sensors"],
    "disturbances": WALKS["disturbances"],
    "faults": (3, "x", [], [None]),
    "seed": WALKS["seed"],
    "width": ("x", None, 1.5, [3]),
    "devices": WALKS["devices"],
}


def one_of(values: dict[str, tuple[Any, ...]], rng: np.random.Generator) -> tuple[str, Any, str]:
    """(name, value, both in words) of one broken argument."""
    name = list(values)[rng.integers(len(values))]
    value = values[name][rng.integers(len(values[name]))]
    return name, value, f"{name} is {value!r:.40}"


def wrong_setting(rng: np.random.Generator, folder: Path) -> str | None:
    """A configuration with one field impossible."""
    settings = SETTINGS[rng.integers(len(SETTINGS))]
    values = {
        f.name: IMPOSSIBLE[type(f.default)] for f in dataclasses.fields(settings) if type(f.default) in IMPOSSIBLE
    }
    name, value, what = one_of(values, rng)
    return refused(f"{settings.__name__}.{what}", lambda: settings(**{name: value}))


def wrong_motion(rng: np.random.Generator, folder: Path) -> str | None:
    """A motion that cannot be, walked."""
    name, value, what = one_of(MOTIONS, rng)
    kind = "path" if name == "file" else str(rng.choice(["straight", "turn", "s_curve", "sideways"]))
    return refused(f"{kind}, {what}", lambda: iw.walk(iw.Motion(**{"kind": kind, name: value})))


def wrong_walk(rng: np.random.Generator, folder: Path) -> str | None:
    """A walk with an argument that cannot be."""
    name, value, what = one_of(WALKS, rng)
    return refused(what, lambda: iw.walk(**{"motion": "straight", name: value}))


def wrong_episodes(rng: np.random.Generator, folder: Path) -> str | None:
    """Episodes with an argument that cannot be."""
    name, value, what = one_of(EPISODES, rng)
    return refused(what, lambda: iw.run_episodes(**{"tasks": "office", name: value}))


def wrong_run(rng: np.random.Generator, folder: Path) -> str | None:
    """A planner from a place that holds none."""
    what, place = odd_place(rng, folder)
    return refused(what, lambda: iw.load_planner(place))


def wrong_image(rng: np.random.Generator, folder: Path) -> str | None:
    """A depth image read from, or written to, what is none; what is written is read back with OpenCV."""
    depth = np.linspace(0.5, 5.0, 90 * 160, dtype=np.float32).reshape(90, 160)
    good = {"file": folder / "good.png", "depth": depth, "depth_scale": 0.001}
    scales = (*NO_NUMBERS, 0.0, -0.001, 5.0, 1e-300)
    way = int(rng.integers(4))
    if way == 0:
        what, place = odd_place(rng, folder, ".png") if rng.random() < 0.6 else unwritable_folder(rng, folder)
        if what == "picture":  # which is one that can be read
            return None
        return refused(what, lambda: iw.read_depth(place))
    if way == 1:
        good["file"].write_bytes(GOOD_IMAGES[0])
        wrong = {"intrinsics": (iw.Intrinsics(99, 90), 3, "x"), "depth_scale": scales, "camera": (None, 3)}
        name, value, what = one_of(wrong, rng)
        return refused(f"read, {what}", lambda: iw.read_depth(good["file"], **{name: value}))
    if way == 2:
        images = (
            "x",
            None,
            depth[None],
            depth[0],
            depth.astype(int),
            1000 * depth,
            depth[:0],
            depth.astype(complex),
            [],
        )
        name, value, what = one_of({"depth": images, "depth_scale": scales}, rng)
        return refused(f"write, {what}", lambda: iw.write_depth(**good | {name: value}))
    entry = float(rng.choice([NAN, INF, -INF, -1.0, 1e30, 0.0]))
    holed = depth.copy()
    holed[rng.random(depth.shape) < 0.2] = entry
    with np.errstate(over="ignore"):
        image = holed.astype(str(rng.choice(["float16", "float32", "float64"])))
    iw.write_depth(good["file"], image)
    found = cv2.imread(str(good["file"]), cv2.IMREAD_UNCHANGED)
    wanted = np.where(holed == depth, 1000 * image.astype(np.float64), 0)
    return None if np.abs(found - wanted).max() < 0.51 else f"holes of {entry}: written as something else"


def wrong_walk_file(rng: np.random.Generator, folder: Path) -> str | None:
    """A footstep or path file with something wrong in it; what is read must be what plain Python reads."""
    kind = str(rng.choice(["footsteps", "path"]))
    steps = [f"{'left' if k % 2 else 'right'}, {0.08 * k:.2f}, {0.05 * (-1) ** (k + 1)}, 0" for k in range(6)]
    lines = steps if kind == "footsteps" else [f"{0.3 * k:.1f}, {0.05 * k:.2f}" for k in range(6)]
    file, k, way = folder / f"{kind}.csv", int(rng.integers(1, 6)), int(rng.integers(8))
    if way == 0:
        what, content = damaged_bytes("\n".join(lines).encode(), rng)
    else:
        values = ("nan", "1e400", "x", "", "9" * 5000, "1;2", "0x10", "1e300", "\x1b[2J", "\u0661", "-50")
        cells = lines[k].split(",")
        cells[rng.integers(len(cells))] = str(rng.choice(values))
        edits = {1: ",".join(cells), 2: lines[k] + ",1", 3: lines[k - 1], 4: "", 5: lines[k].replace(",", "\t"),
                 6: lines[k] + "\0", 7: ",".join(cells[:-1])}  # fmt: skip
        lines[k] = edits[way]
        what, content = f"way {way}, {lines[k]!r:.40}", "\n".join(lines).encode()
    file.write_bytes(content)
    what = f"{kind}, {what}"
    try:
        walk = make_walk(iw.Motion(kind, file=file))
    except iw.InputError as error:
        wrong = is_no_sentence(str(error))
        return wrong and f"{what}: {wrong}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    rows = [line.split(",") for line in content.decode().splitlines() if line.strip() and not line.startswith("#")]
    wanted = np.array([[float(cell) for cell in row[1:3] if kind == "footsteps"] or [*map(float, row)] for row in rows])
    found = np.asarray(walk.plan.positions[: len(wanted)] if walk.path is None else walk.path, np.float64)
    shifted = found - found[:1]
    if walk.path is not None:
        wanted = wanted[[True, *(np.diff(wanted, axis=0) != 0).any(axis=1)]]
    close = shifted.shape == wanted.shape and np.allclose(shifted, wanted - wanted[:1], atol=1e-4)
    return None if close else f"{what}: read as other places"


KINDS: dict[str, Kind] = {
    "settings": wrong_setting,
    "motion": wrong_motion,
    "walk_arguments": wrong_walk,
    "episode_arguments": wrong_episodes,
    "walk_file": wrong_walk_file,
    "run": wrong_run,
    "depth_image": wrong_image,
}
