"""Files that the product wrote and reads back, damaged or edited: refused with a sentence, or read as they were.

Of a file with checksum lines the lines that are damaged may be passed over, but none may be read as another.
"""

import contextlib
import functools
import io
import json
import shutil
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.data import FrameSet, load_frames, save_frames
from iwalker_jax.errors import CheckpointError, InputError
from iwalker_jax.evaluation.episodes.log import EpisodeKey, append_episodes, load_episodes
from iwalker_jax.evaluation.episodes.metrics import EpisodeMetrics
from iwalker_jax.evaluation.walks import WalkLabels, load_walk_table, with_case
from iwalker_jax.evaluation.walks.tables import EMPTY_WALK_TABLE, WALK_COLUMNS
from iwalker_jax.navigation import Outcome
from iwalker_jax.optimization import QuadraticProgram, load_program
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import IPathConfig, IStepperConfig, PlannerConfig
from iwalker_jax.runtime import write_npz
from iwalker_jax.training import TrainConfig, load_run
from iwalker_jax.training.checkpoints import CheckpointStore
from iwalker_jax.training.pretrained import load_planner, save_planner
from iwalker_jax.training.train_step import initial_state, make_optimiser, planner_from
from tests.malformed.kinds import Kind
from tests.malformed.odd_files import odd_place
from tests.malformed.sentences import is_no_sentence

CONFIG = TrainConfig(
    planner=PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=8), istepper=IStepperConfig(hidden=8)), batch_size=2
)
"""Of networks so small that a case takes no time."""


@functools.cache
def good_folder() -> Path:
    """Where the files lie that are damaged in copies."""
    return Path(tempfile.mkdtemp(prefix="good"))


@functools.cache
def state() -> Any:
    """Of a training that has just begun."""
    return initial_state(CONFIG, make_optimiser(CONFIG, 10))


def write_frames(file: Path) -> None:
    rng = np.random.default_rng(0)
    n = 4
    frames = FrameSet(
        rng.integers(0, 6000, (n, 12, 16), dtype=np.uint16), rng.uniform(0.1, 1, (n, 5)).astype(np.float32),
        rng.uniform(-4, 4, (n, 2, 2)).astype(np.float32), rng.uniform(-4, 4, (n, 3)).astype(np.float32),
        np.array([0, 0, 1, 1], np.int32), ("a", "b"), Intrinsics(16, 12, 8.0, 8.0, 7.5, 5.5),
    )  # fmt: skip
    save_frames(frames, file)


def write_program(file: Path) -> None:
    arrays = (jnp.eye(3), jnp.ones(3), jnp.ones((2, 3)), jnp.zeros(2), jnp.ones(2))
    QuadraticProgram(*arrays, blocks=(("first", 1), ("second", 1))).save(file)


def write_log(file: Path) -> None:
    figures = EpisodeMetrics(Outcome(1), **{name: 0.5 + k for k, name in enumerate(EpisodeMetrics._fields[1:])})
    keys = [EpisodeKey("pretrained", "noisy", "estimated", 0, 20, "default", "office", k) for k in range(5)]
    append_episodes(file, [(key, f"office-{key.number}", figures) for key in keys])


def write_table(file: Path) -> None:
    table = EMPTY_WALK_TABLE
    for k in range(4):
        values = {column.title: k + 0.25 * n for n, column in enumerate(WALK_COLUMNS)}
        table = with_case(table, WalkLabels("nominal", f"case {k}", "mjx", "0"), values)
    table.save(file.parent, file.stem, checksums=True)


def planner_arrays(file: Path) -> Any:
    planner, config = load_planner(file)
    return repr(config), jax.tree.leaves(planner_state(planner))


def planner_state(planner: Any) -> Any:
    from flax import nnx

    return nnx.state(planner, nnx.Param)


def frame_arrays(file: Path) -> Any:
    return list(vars(load_frames(file)).values())


def program_arrays(file: Path) -> Any:
    program = load_program(file)
    return [*program.arrays(), program.blocks]


@dataclass(frozen=True)
class Saved:
    """A kind of file.

    Attributes:
        name: of the file.
        write: makes a good one.
        read: as the product does, into what can be compared.
        by_line: whether damaged lines may be passed over; what is read is then a dictionary or list of them.
        foreign: whether one without a checksum, written by others, is as good.
    """

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], Any]
    by_line: bool = False
    foreign: bool = False


SAVED = {
    "planner_file": Saved("planner.npz", lambda file: save_planner(file, planner_from(CONFIG, state().params), CONFIG),
                          planner_arrays),
    "frame_file": Saved("frames.npz", write_frames, frame_arrays),
    "program_file": Saved("program.npz", write_program, program_arrays, foreign=True),
    "episode_log": Saved("episodes.csv", write_log, lambda file: list(load_episodes(file).items()), by_line=True),
    "walk_table": Saved("walk_study.csv", write_table, lambda file: list(load_walk_table(file).rows)),
}  # fmt: skip


@functools.cache
def good_file(kind: str) -> tuple[bytes, Any]:
    """Content of a good file of a kind, and what it is read as."""
    saved = SAVED[kind]
    file = good_folder() / saved.name
    saved.write(file)
    return file.read_bytes(), saved.read(file)


def same(first: Any, second: Any) -> bool:
    """Whether two things that were read are the same to the bit."""
    if isinstance(first, (list, tuple)):
        return len(first) == len(second) and all(map(same, first, second))
    if hasattr(first, "shape"):
        a, b = np.asarray(first), np.asarray(second)
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return bool(first == second)


def damaged_bytes(content: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """(what is broken, bytes) of a file on a bad disk or after a bad transfer."""
    damaged = bytearray(content)
    at, span = int(rng.integers(len(content))), int(rng.integers(1, max(2, len(content) // 4)))
    way = int(rng.integers(8))
    if way < 3:
        for _ in range(10**way // 5 + 1):
            damaged[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    elif way == 3:
        del damaged[at:]
    elif way == 4:
        del damaged[:span]
    elif way == 5:
        damaged[at : at + span] = bytes(len(damaged[at : at + span]))
    elif way == 6:
        damaged[at:at] = rng.bytes(span)
    else:
        damaged += damaged[-span:]
    return f"bytes, way {way}", bytes(damaged)


def plain_npz(arrays: Mapping[str, Any], pickled: bool = False) -> bytes:
    """An .npz file as NumPy writes it, so without a checksum."""
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=pickled, **arrays)
    return stream.getvalue()


def signed_npz(arrays: Mapping[str, Any], folder: Path) -> bytes:
    """An .npz file whose checksum is right, whatever is in it."""
    file = folder / "signed.npz"
    write_npz(file, arrays)
    content = file.read_bytes()
    file.unlink()
    return content


def huge_member(content: bytes, rng: np.random.Generator) -> bytes:
    """The file with a member that says it is huge, or is."""
    stream, into = io.BytesIO(content), io.BytesIO()
    with zipfile.ZipFile(stream) as old, zipfile.ZipFile(into, "w", zipfile.ZIP_DEFLATED) as new:
        names = old.namelist()
        chosen = names[rng.integers(len(names))]
        for name in names:
            new.writestr(name, old.read(name) if name != chosen else _huge_array(rng))
    return into.getvalue()


def _huge_array(rng: np.random.Generator) -> bytes:
    header = io.BytesIO()
    rows = int(10 ** rng.uniform(8, 15)) if rng.random() < 0.7 else 300_000_000
    np.lib.format.write_array_header_1_0(header, {"descr": "|u1", "fortran_order": False, "shape": (rows,)})
    return header.getvalue() + (bytes(rows) if rows == 300_000_000 else bytes(1000))


def edited_arrays(content: bytes, rng: np.random.Generator) -> tuple[str, dict[str, Any]]:
    """(what is broken, arrays) of a file whose members were exchanged, left out, or are of another kind."""
    with np.load(io.BytesIO(content)) as stored:
        arrays: dict[str, Any] = {name: stored[name] for name in stored.files if name != "sha256"}
    names = list(arrays)
    first, second = (names[k] for k in rng.choice(len(names), 2, replace=False))
    way = int(rng.integers(8))
    value = arrays[first]
    # Two members of one kind that change places make another file, not a broken one.
    if way == 0 and (value.shape, value.dtype) != (arrays[second].shape, arrays[second].dtype):
        arrays[first], arrays[second] = arrays[second], arrays[first]
    elif way <= 1:
        del arrays[first]
    elif way == 2:
        arrays[first] = value.astype("U" if value.dtype.kind != "U" else "S")
    elif way == 3:
        arrays[first] = np.stack([value, value])
    elif way == 4:
        arrays[first] = value[..., :0] if value.ndim else np.zeros(0)
    elif way == 5:
        arrays[first] = np.full(value.shape, np.nan, np.float32)
    elif way == 6:
        arrays[first] = np.asarray('{"a": ' * 50 + "1" + "}" * 50)
    else:
        arrays[first] = np.zeros(value.shape, np.complex64)
    return f"{first}, way {way}", arrays


def damaged_npz(saved: Saved, content: bytes, rng: np.random.Generator, folder: Path) -> tuple[str, bytes, bool]:
    """(what is broken, bytes, whether it must be refused) of an .npz file."""
    way = int(rng.integers(6))
    if way < 2:
        return *damaged_bytes(content, rng), False
    if way == 2:
        return "a huge member", huge_member(content, rng), True
    what, arrays = edited_arrays(content, rng)
    if way == 3:
        return f"edited {what}", plain_npz(arrays), not saved.foreign
    if way == 4:
        arrays[next(iter(arrays))] = np.array([{}, print], object)
        return "pickled objects", plain_npz(arrays, pickled=True), True
    return f"edited and signed {what}", signed_npz(arrays, folder), not saved.foreign


def edited_text(content: bytes, rng: np.random.Generator) -> tuple[str, bytes]:
    """(what is broken, bytes) of a table that somebody edited."""
    lines = content.decode().splitlines()
    k, way = int(rng.integers(1, len(lines))), int(rng.integers(7))
    if way == 0:
        lines[k] = lines[k].replace("5", "6")
    elif way == 1:
        cells = lines[k].split(",")
        a, b = rng.choice(len(cells), 2, replace=False)
        cells[a], cells[b] = cells[b], cells[a]
        lines[k] = ",".join(cells)
    elif way == 2:
        lines[0] = lines[0].replace("e", "E")
    elif way == 3:
        lines[k] += ",1"
    elif way == 4:
        lines[k] = '"' + lines[k]
    elif way == 5:
        lines[k] = lines[k] + "\0"
    else:
        lines[k] = "9" * 5000 + "," * 40
    return f"text, way {way}", "\n".join([*lines, ""]).encode()


def read_back(kind: str, rng: np.random.Generator, folder: Path) -> str | None:
    """Damage a file and read it; what is wrong with what came of it."""
    saved = SAVED[kind]
    content, good = good_file(kind)
    refuse = False
    if rng.random() < 0.1:
        what, place = odd_place(rng, folder, Path(saved.name).suffix)
        file, refuse = Path(place), not (kind in ("episode_log", "walk_table") and what in ("nothing", "empty file"))
    else:
        file = folder / saved.name
        if file.suffix == ".npz":
            what, content, refuse = damaged_npz(saved, content, rng, folder)
        else:
            what, content = damaged_bytes(content, rng) if rng.random() < 0.5 else edited_text(content, rng)
        file.write_bytes(content)
    try:
        found = saved.read(file)
    except (InputError, CheckpointError) as error:
        wrong = is_no_sentence(str(error))
        return wrong and f"{what}: {wrong}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    if same(found, good) and not refuse:
        return None
    if saved.by_line and all(any(same(one, other) for other in good) for one in found):
        return None
    if not refuse and saved.foreign and "edited" in what:
        return None if all(np.asarray(part).dtype.kind in "fiu" for part in found[:5]) else f"{what}: read as numbers"
    if file.suffix == ".csv" and not found and not file.exists():
        return None
    return f"{what}: read as something else"


@functools.cache
def good_run() -> Path:
    """A run of two checkpoints."""
    run = good_folder() / "run"
    store = CheckpointStore(run / "checkpoints")
    with contextlib.redirect_stderr(io.StringIO()):
        for step in (2, 4):
            store.save(state()._replace(step=jnp.asarray(step, jnp.int32)), CONFIG, frames=4)
        store.close()
    return run


def prepare() -> None:
    """The good files, which take some seconds."""
    for kind in SAVED:
        good_file(kind)
    load_run(good_run(), say=lambda _: None)


def damaged_checkpoint(rng: np.random.Generator, folder: Path) -> str | None:
    """Damage a file of the newest checkpoint; an older one must be taken, with a sentence, or the same one be read."""
    run = folder / "run"
    shutil.copytree(good_run(), run)
    files = sorted(file for file in (run / "checkpoints" / "4").rglob("*") if file.is_file() and file.stat().st_size)
    file = files[rng.integers(len(files))]
    content = file.read_bytes()
    way = int(rng.integers(6))
    if way == 0:
        file.unlink()
        what = "missing"
    elif way == 1 and b"{" in content[:2]:
        values = json.loads(content)
        file.write_text(json.dumps(values).replace("16", "32").replace("4", "5"))
        what = "edited"
    elif way == 2:
        file.unlink()
        file.mkdir()
        what = "a folder"
    else:
        what, damaged = damaged_bytes(content, rng)
        file.write_bytes(damaged)
    what = f"{file.relative_to(run)} {what}"
    said: list[str] = []
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            found, config = load_run(run, say=said.append)
    except CheckpointError as error:
        return f"{what}: does not take the older one: {error}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    step = int(found.step)
    wanted = state()._replace(step=jnp.asarray(step, jnp.int32))
    equal = config == CONFIG and same(jax.tree.leaves(found), jax.tree.leaves(wanted))
    if not equal or step not in (2, 4):
        return f"{what}: read as something else"
    if step == 2 and (len(said) != 1 or is_no_sentence(said[0])):
        return f"{what}: takes the older one and says {said}"
    return None


KINDS: dict[str, Kind] = {
    **{kind: partial(read_back, kind) for kind in SAVED},
    "checkpoint": damaged_checkpoint,
}
