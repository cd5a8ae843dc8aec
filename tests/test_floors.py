"""The floors of the house: who may import whom, read from the source with `ast`, so that nothing need be run."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

FLOORS = (
    ("errors", "constants", "lazy_names", "promotion", "version"),
    ("arrays", "checks", "streams", "runtime", "geometry"),
    ("optimization", "bruce_model"),
    ("perception", "robot"),
    ("planning", "scenes", "control", "estimation"),
    ("humanoids",),
    ("tasks", "walking"),
    ("navigation", "film"),
    ("data", "deployment", "surrogate"),
    ("training", "evaluation"),
    ("api",),
    ("commands",),
    ("experiments",),
    ("benchmarks",),
    ("examples", "notebooks"),
)
"""Rooms from the ground up: a file imports from its own room and from floors below, never beside or above."""

LOWEST = {room: number for number, floor in enumerate(FLOORS) for room in floor}
LARGEST_ROOM = 16
"""Files of one folder at most."""


def product_files() -> list[Path]:
    """All Python files that are not tests."""
    folders = [ROOT / name for name in ("iwalker_jax", "experiments", "benchmarks", "bruce_model", "examples")]
    return sorted(file for folder in folders for file in folder.rglob("*.py"))


def room_of(module: str) -> str | None:
    """The room of a dotted module; None for one of another project, or for the front door itself."""
    head, *rest = module.split(".")
    if head == "iwalker_jax":
        return rest[0] if rest else None
    if (head, *rest[:1]) == ("experiments", "notebooks"):
        return "notebooks"
    return head if head in LOWEST else None


def imported_modules(file: Path) -> list[str]:
    """Every module that a file names in an import, inside functions too."""
    modules: list[str] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: write imports in full"
            modules.append(node.module or "")
    return modules


def module_of(file: Path) -> str:
    """The dotted name of a file."""
    parts = file.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_imports_point_down():
    climbing = []
    for file in product_files():
        own = room_of(module_of(file))
        for module in imported_modules(file):
            other = room_of(module)
            if own is None or other is None or own == other:
                continue
            assert own in LOWEST, f"{file.relative_to(ROOT)} is in a room without a floor; name it in FLOORS"
            assert other in LOWEST, f"{file.relative_to(ROOT)} imports {module}, a room without a floor"
            if LOWEST[other] >= LOWEST[own]:
                climbing.append(f"{file.relative_to(ROOT)} imports {module}")
    assert not climbing, "imports that climb or go sideways:\n" + "\n".join(climbing)


def test_nobody_goes_back_out_through_the_front_door():
    out = [
        str(file.relative_to(ROOT))
        for file in product_files()
        if room_of(module_of(file)) not in (None, *FLOORS[-1]) and "iwalker_jax" in imported_modules(file)
    ]
    assert out == [], "the front door is for users; import from the room"


def test_examples_and_notebooks_go_in_by_the_front_door_and_the_faces_of_rooms():
    deep = [
        f"{file.relative_to(ROOT)} imports {module}"
        for file in product_files()
        if room_of(module_of(file)) in FLOORS[-1]
        for module in imported_modules(file)
        if module.split(".")[0] in ("iwalker_jax", "experiments", "benchmarks", "bruce_model")
        and not (ROOT / module.replace(".", "/") / "__init__.py").exists()
    ]
    assert deep == [], "examples and notebooks import from faces"


def test_no_circles_between_files():
    names = {module_of(file) for file in product_files()}
    graph = {}
    for file in product_files():
        edges = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module:
                inside = {f"{node.module}.{alias.name}" for alias in node.names} & names
                edges |= inside or ({node.module} & names)
        graph[module_of(file)] = edges - {module_of(file)}
    done: set[str] = set()
    for start in graph:
        way = [start]
        branches = [iter(sorted(graph[start]))]
        while branches:
            following = next(branches[-1], None)
            if following is None:
                branches.pop()
                done.add(way.pop())
            elif following in way:
                pytest.fail("a circle of imports: " + " -> ".join([*way[way.index(following) :], following]))
            elif following not in done:
                way.append(following)
                branches.append(iter(sorted(graph[following])))


@pytest.mark.parametrize("package", ["iwalker_jax", "experiments", "benchmarks", "bruce_model", "examples"])
def test_no_room_is_crowded(package):
    folders = {file.parent for file in (ROOT / package).rglob("*.py")}
    crowded = {str(f.relative_to(ROOT)): len(list(f.glob("*.py"))) for f in folders}
    assert {name: count for name, count in crowded.items() if count > LARGEST_ROOM} == {}
