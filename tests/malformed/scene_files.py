"""Scene files and tasks that are damaged, hostile or no place to walk in.

What must come of a case: `refused` in a sentence, `same` as the scene without the change, or `finite` (refused, or a
scene of finite sizes, where a damaged number may still be one).
"""

import functools
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from iwalker_jax.errors import InputError
from iwalker_jax.scenes import Scene
from iwalker_jax.scenes.imported.user_scene import UserScene, convert_user_scene
from iwalker_jax.tasks import Task, check_task
from tests.malformed.kinds import Kind
from tests.malformed.odd_files import odd_place
from tests.malformed.saved_files import damaged_bytes
from tests.malformed.sentences import is_no_sentence, refused

Broken = tuple[str, Path, str]
"""What is broken, the file, and what must come of it."""

SUFFIXES = (".obj", ".stl", ".glb", ".ply", ".off")


@functools.cache
def room() -> trimesh.Trimesh:
    """A floor of 3 x 2 m with two boxes on it, z up."""
    parts = [trimesh.creation.box((3.0, 2.0, 0.1)), trimesh.creation.box((0.4, 0.4, 0.8)),
             trimesh.creation.box((0.3, 0.5, 1.0))]  # fmt: skip
    for part, shift in zip(parts, ((0, 0, -0.05), (0.8, 0.3, 0.4), (-0.9, -0.4, 0.5)), strict=True):
        part.apply_translation(shift)
    return trimesh.util.concatenate(parts)


def exported(mesh: trimesh.Trimesh, suffix: str) -> bytes:
    """Content of a file of a mesh."""
    content = mesh.export(file_type=suffix[1:])
    return content.encode() if isinstance(content, str) else bytes(content)


def changed_mesh(rng: np.random.Generator) -> tuple[str, trimesh.Trimesh, str]:
    """(what is broken, mesh, what must come of it) of a mesh that is a file like any other."""
    mesh = room().copy()
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    ways: dict[str, tuple[np.ndarray, np.ndarray, str]] = {
        "millimetres": (1000 * vertices, faces, "refused"),
        "micrometres": (1e6 * vertices, faces, "refused"),
        "tiny": (1e-4 * vertices, faces, "refused"),
        "no floor": (vertices[8:], faces[12:] - 8, "refused"),
        "far origin": (vertices + np.array([5e5, 4e6, 0.0]), faces, "finite"),
        "degenerate triangles": (vertices, np.concatenate([faces, np.zeros((50, 3), int)]), "same"),
        "only degenerate triangles": (vertices, np.zeros((20, 3), int), "refused"),
        "flat": (vertices * [1.0, 1.0, 0.0], faces, "refused"),
        "one triangle": (vertices[:3], np.array([[0, 1, 2]]), "refused"),
        "huge": (vertices * 1e30, faces, "refused"),
        "sloping floor": (
            vertices @ trimesh.transformations.rotation_matrix(0.3, [1, 0, 0])[:3, :3].T,
            faces,
            "refused",
        ),
        "not a number": (np.where(np.arange(len(vertices))[:, None] == 3, np.nan, vertices), faces, "refused"),
        "infinite": (np.where(np.arange(len(vertices))[:, None] == 3, np.inf, vertices), faces, "refused"),
        "as it is": (vertices, faces, "same"),
    }
    what = str(rng.choice(list(ways)))
    vertices, faces, expected = ways[what]
    return what, trimesh.Trimesh(vertices, faces, process=False), expected


def broken_mesh(rng: np.random.Generator, folder: Path) -> Broken:
    """A mesh file of any kind."""
    suffix = str(rng.choice(SUFFIXES))
    file = folder / f"scene{suffix}"
    way = rng.random()
    if way < 0.1:
        what, place = odd_place(rng, folder, suffix)
        return what, Path(place), "refused"
    if way < 0.6:
        what, mesh, expected = changed_mesh(rng)
        file.write_bytes(exported(mesh, suffix))
        return f"{suffix} {what}", file, expected
    content = exported(room(), suffix)
    if way < 0.9:
        what, damaged = damaged_bytes(content, rng)
        file.write_bytes(damaged)
        return f"{suffix} {what}", file, "finite"
    lies = {
        ".ply": content.replace(b"element vertex 24", b"element vertex 2000000000"),
        ".stl": content[:80] + (4_000_000_000).to_bytes(4, "little") + content[84:],
        ".obj": content + b"f 1 2 999999999\nf -9999 1 2\nv nan nan nan\n" + b"f 1 2 3\n" * 3,
        ".glb": content[:8] + (2**32 - 1).to_bytes(4, "little") + content[12:],
        ".off": content.replace(b"24 36", b"24 999999999"),
    }
    file.write_bytes(lies[suffix])
    return f"{suffix} says that it is larger", file, "refused" if suffix == ".ply" else "finite"


LINKS = ("/dev/zero", "pipe.bin", "absent.bin", "/etc/passwd", "scene.gltf", "http://127.0.0.1:9/a.bin", "a%00b", "",
         "data:application/octet-stream;base64,####", "../" * 40 + "etc/passwd", "/dev/%7aero", "x" * 300)  # fmt: skip
"""What a .gltf file may give for the place of its numbers, though none are there."""


def linked_mesh(rng: np.random.Generator, folder: Path) -> Broken:
    """A .gltf file whose numbers lie elsewhere."""
    files = room().export(file_type="gltf")
    content = json.loads(files.pop("model.gltf"))
    file = folder / "scene.gltf"
    for name, data in files.items():
        (folder / name).write_bytes(data)
    os.mkfifo(folder / "pipe.bin")
    buffers = content["buffers"]
    way = int(rng.integers(4))
    if way == 0:
        what, content = "a part is missing", content | {str(rng.choice(["buffers", "accessors", "bufferViews"])): []}
    elif way == 1:
        what, content["accessors"][0]["count"] = "count", int(rng.choice([10**9, -1, 2**63 - 1]))
    else:
        link = str(rng.choice(LINKS))
        what, buffers[rng.integers(len(buffers))]["uri"] = f"numbers in {link!r:.40}", link
    file.write_text(json.dumps(content))
    return f".gltf {what}", file, "refused"


MODEL = """<mujoco><compiler angle="degree"/><asset></asset><worldbody>
<geom type="plane" size="0 0 1"/><geom type="box" pos="1.0 0.5 0.5" size="0.3 0.3 0.5"/>
<geom type="cylinder" pos="-1 0 0.4" size="0.2 0.4"/></worldbody></mujoco>"""


def hostile_models() -> dict[str, tuple[str, str]]:
    """MJCF texts by what is wrong with them, with what must come of them."""
    body = "<body>" * 5000 + "</body>" * 5000
    entities = "<!DOCTYPE m [<!ENTITY a 'xxxxxxxxxx'>" + "".join(
        f"<!ENTITY {'b' * k} '{f'&{chr(98) * (k - 1) or chr(97)};' * 10}'>" for k in range(1, 9)) + "]>"  # fmt: skip
    asset = "<asset></asset>"
    return {
        "include of a system file": (MODEL.replace(asset, '<include file="/etc/passwd"/>'), "refused"),
        "include of itself": (MODEL.replace(asset, '<include file="scene.xml"/>'), "refused"),
        "include outside": (MODEL.replace(asset, '<include file="../../../absent.xml"/>'), "refused"),
        "include of a device": (MODEL.replace(asset, '<include file="/dev/zero"/>'), "refused"),
        "include of a pipe": (MODEL.replace(asset, '<include file="pipe.xml"/>'), "refused"),
        "include of a device by entities": (
            MODEL.replace(asset, '<include file="&#47;dev/zero"/>'),
            "refused",
        ),
        "heights of a device": (MODEL.replace(asset, '<asset><hfield file="/dev/zero" name="h"/></asset>'), "refused"),
        "texture of a pipe": (
            MODEL.replace(asset, '<asset><texture type="2d" file="pipe.png" name="t"/></asset>'),
            "refused",
        ),
        "mesh in a folder of devices": (
            MODEL.replace("<asset></asset>", '<asset><mesh file="zero" name="m"/></asset>').replace(
                'angle="degree"', 'angle="degree" meshdir="/dev"'
            ),
            "refused",
        ),
        "mesh of a device": (MODEL.replace(asset, '<asset><mesh file="/dev/zero" name="m"/></asset>'), "refused"),
        "mesh of a system file": (
            MODEL.replace(asset, '<asset><mesh file="/etc/passwd" name="m"/></asset>'),
            "refused",
        ),
        "entities": (entities + MODEL.replace("box", "&bbbbbbbb;"), "refused"),
        "external entity": ('<!DOCTYPE m [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + MODEL + "&e;", "finite"),
        "deep nesting": (MODEL.replace("</worldbody>", body + "</worldbody>"), "finite"),
        "NaN": (MODEL.replace("1.0 0.5", "nan 0.5"), "refused"),
        "infinity": (MODEL.replace("1.0 0.5", "inf 0.5"), "refused"),
        "far": (MODEL.replace("1.0 0.5", "1e9 0.5"), "refused"),
        "huge": (MODEL.replace("0.3 0.3 0.5", "3e5 0.3 0.5"), "refused"),
        "negative size": (MODEL.replace("0.3 0.3 0.5", "-0.3 0.3 0.5"), "refused"),
        "raised floor": (MODEL.replace('size="0 0 1"', 'size="0 0 1" pos="0 0 0.4"'), "refused"),
        "tilted floor": (MODEL.replace('size="0 0 1"', 'size="0 0 1" euler="20 0 0"'), "refused"),
        "nothing": ("<mujoco/>", "refused"),
        "no obstacle": ('<mujoco><worldbody><geom type="plane" size="0 0 1"/></worldbody></mujoco>', "refused"),
        "unknown element": (MODEL.replace(asset, "<assets/>"), "refused"),
        "other document": ("<robot name='x'><link name='a'/></robot>", "refused"),
        "empty": ("", "refused"),
        "comment": (MODEL.replace(asset, "<!-- caf\u00e9 -->"), "same"),
    }


def broken_model(rng: np.random.Generator, folder: Path) -> Broken:
    """An MJCF file."""
    file = folder / "scene.xml"
    way = rng.random()
    if way < 0.1:
        what, place = odd_place(rng, folder, ".xml")
        return what, Path(place), "refused"
    if way < 0.35:
        what, damaged = damaged_bytes(MODEL.encode(), rng)
        file.write_bytes(damaged)
        return what, file, "finite"
    models = hostile_models()
    what = str(rng.choice(list(models)))
    for name in ("pipe.xml", "pipe.png"):
        os.mkfifo(folder / name)
    file.write_text(models[what][0])
    return what, file, models[what][1]


@functools.cache
def good_scene(suffix: str) -> UserScene:
    """The scene without any damage."""
    folder = Path(os.environ.get("TMPDIR", "/tmp")) / f"good-scene-{os.getpid()}"
    folder.mkdir(exist_ok=True)
    file = folder / f"scene{suffix}"
    file.write_bytes(MODEL.encode() if suffix == ".xml" else exported(room(), suffix))
    try:
        return convert_user_scene(file)
    finally:
        file.unlink()
        folder.rmdir()


def numbers_of(scene: UserScene) -> np.ndarray:
    """All numbers of a scene's boxes and cylinders in a row."""
    arrays = [np.ravel(np.asarray(leaf, float)) for leaf in scene.scene.arrays() if np.asarray(leaf).dtype.kind == "f"]
    return np.concatenate(arrays)


def convert(make: Callable[[np.random.Generator, Path], Broken], rng: np.random.Generator, folder: Path) -> str | None:
    """Convert a broken file; what is wrong with what came of it."""
    what, file, expected = make(rng, folder)
    try:
        found = convert_user_scene(file)
    except InputError as error:
        wrong = is_no_sentence(str(error)) or ("quotes a system file" if "root:" in str(error) else None)
        wrong = wrong or (f"refused: {error}" if expected == "same" else None)
        return wrong and f"{what}: {wrong}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    if expected == "refused":
        return f"{what}: walkable: {found.describe()[:200]}"
    numbers = numbers_of(found)
    if np.isnan(numbers).any() or not np.isfinite(found.scene.bounds).all():
        return f"{what}: not finite"
    good = numbers_of(good_scene(file.suffix))
    if expected == "same" and not (numbers.shape == good.shape and np.allclose(numbers, good, atol=0.02)):
        return f"{what}: another scene than without it"
    return None


BOUNDS: tuple[Any, ...] = (
    (np.nan, -1.0, 1.0, 1.0), (-1.0, -1.0, np.inf, 1.0), (1.0, 1.0, -1.0, -1.0), (0.0, 0.0, 0.0, 1.0), (-1.0, 1.0),
    (-1.0, -1.0, 1.0, 1.0, 1.0), ("a", "b", "c", "d"), (-1e6, -1e6, 1e6, 1e6), (50.0, 50.0, 52.0, 52.0), "bounds", 3.0,
    (1e300, 1e300, 1.1e300, 1.1e300), [[-1.0, -1.0, 1.0, 1.0]], (1j, 0, 1, 1),
)  # fmt: skip


def wrong_options(rng: np.random.Generator, folder: Path) -> str | None:
    """A good file with bounds or an upward axis that cannot be."""
    suffix = str(rng.choice([".obj", ".xml"]))
    file = folder / f"scene{suffix}"
    file.write_bytes(MODEL.encode() if suffix == ".xml" else exported(room(), suffix))
    options: dict[str, Any] = {"bounds": BOUNDS[rng.integers(len(BOUNDS))]}
    if suffix == ".obj" and rng.random() < 0.3:
        options = {"up": ("w", "Z", "", 2, "-z", ["z"], 1.5)[rng.integers(7)]}
    return refused(f"{options!r:.80}", lambda: convert_user_scene(file, **options))


def wrong_scene(rng: np.random.Generator, folder: Path) -> str | None:
    """A scene put together of what is no scene."""
    box, cylinder, nan = [1.0, 0.5, 0.5, 0.3, 0.3, 0.5, 0.0], [-1.0, 0.0, 0.4, 0.2, 0.4], float("nan")
    good: dict[str, Any] = {"name": "good", "family": "user", "boxes": np.array([box]), "ceiling": 2.5,
                            "cylinders": np.array([cylinder]), "bounds": (-3.0, -2.0, 3.0, 2.0)}  # fmt: skip
    broken = {"boxes": wrong_rows(box), "cylinders": wrong_rows(cylinder), "bounds": (*BOUNDS[:7], *BOUNDS[9:], None),
              "ceiling": (nan, -1.0, 0.0, np.inf, "high", [2.5])}  # fmt: skip
    name = str(rng.choice(list(broken)))
    value = broken[name][rng.integers(len(broken[name]))]
    return refused(f"{name} {value!r:.60}", lambda: Scene(**good | {name: value}))


def wrong_rows(row: list[float]) -> tuple[Any, ...]:
    """What is no list of solids like this one."""
    first, sizes = ([entry, *row[1:]] for entry in (float("nan"), "a", np.inf, 1j)), (0.0, -1.0)
    flat = ([*row[:3], size, *row[4:]] for size in sizes)
    return (None, row, [row[:-1]], [row, row[:3]], {"a": row}, "rows", *([each] for each in (*first, *flat)))


def good_task() -> Task:
    """A task in the model's scene."""
    return Task("good", good_scene(".xml").scene, (0.0, -1.0, 0.5), np.array([[0.0, 1.2]]), 30.0)


def wrong_task(rng: np.random.Generator, folder: Path) -> str | None:
    """A task whose start, goals or time cannot be."""
    good, nan, inf = good_task(), float("nan"), float("inf")
    x, y = good.goals[0].tolist()
    broken: dict[str, list[Any]] = {
        "start": [(nan, 0.0, 0.0), (inf, 0.0, 0.0), (1e9, 1e9, 0.0), (0.0, 0.0), (0.0, -1.0, nan), (1e300, 0.0, 0.0),
                  (), (1.0, 0.5, 0.0), ("a", "b", "c"), None, [[0.0, -1.0, 0.5]], 3.0, (1j, 0, 0)],
        "goals": [[[nan, 0.0]], [[inf, 0.0]], [[1e9, 0.0]], [[x, y, 0.0]], [], [[x, y]] * 99, [x, y], [[]],
                  [[1e300, 1e300]], [["a", "b"]], [[x, y], [x]], None, [[1.0, 0.5]], "goal", [[1j, 0.0]]],
        "time_limit": [nan, 0.0, -1.0, inf, 1e30, "60", None],
        "scene": [None, "office", good.goals],
    }  # fmt: skip
    name = str(rng.choice(list(broken)))
    values = {"start": good.start, "goals": good.goals, "time_limit": good.time_limit, "scene": good.scene}
    values[name] = broken[name][rng.integers(len(broken[name]))]
    what = f"{name} {values[name]!r:.60}"
    return refused(what, lambda: check_task(Task("broken", **values)))


KINDS: dict[str, Kind] = {
    "mesh": partial(convert, broken_mesh),
    "linked_mesh": partial(convert, linked_mesh),
    "model": partial(convert, broken_model),
    "scene_options": wrong_options,
    "scene_object": wrong_scene,
    "task": wrong_task,
}


def prepare() -> None:
    """The good scenes."""
    for suffix in (*SUFFIXES, ".xml"):
        good_scene(suffix)
    check_task(good_task())
