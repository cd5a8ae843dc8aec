"""Pages against the project itself: every command parses, every name, file, link and picture exists.

The oracle of an option is the parser of its own command, of a name Python's import, of a link the file system.
"""

import importlib
import importlib.util
import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import pytest

from iwalker_jax.navigation.navigators import POLICIES
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.optimization import GradientMode, Status
from iwalker_jax.training.config import PRESETS
from tests.docs.command_line import parse_command
from tests.docs.pages import (
    PACKAGES,
    PAGES,
    ROOT,
    dotted_names,
    fenced_blocks,
    headings,
    module_commands,
    named_files,
    named_tests,
    option_spans,
    relative_links,
    shell_lines,
)
from tests.test_floors import FLOORS

PROGRAMS = {"pip", "python", "ruff", "mypy", "pre-commit", "git", "jupyter", "mkdocs", "docker", ".ci/run"}
"""What shell blocks may start."""

LANGUAGES = {"python", "bash", "yaml", "toml", "text", "csv"}

by_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def commands_in(folder: str) -> set[str]:
    """Modules of a folder that are commands."""
    files = [file for file in (ROOT / folder).rglob("*.py") if "__main__" in file.read_text(encoding="utf-8")]
    return {".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__main__") for file in files}


@by_page
def test_every_command_is_taken_by_its_parser(page):
    refused = []
    for command in module_commands(page):
        if command.module.split(".")[0] not in PACKAGES:
            assert importlib.util.find_spec(command.module), f"{page.name}:{command.line}: no module {command.module}"
            continue
        complaint = parse_command(command.module, command.arguments)
        if complaint is not None:
            refused.append(f"{page.name}:{command.line}: {command}\n{complaint}")
    assert not refused, "\n".join(refused)


@by_page
def test_every_option_in_the_text_belongs_to_a_command_named_with_it(page):
    refused = []
    for option in option_spans(page):
        words = tuple(option.text.split())
        commands = dict.fromkeys(command.module for command in option.commands)
        if not any(takes(name, words) for name in commands):
            refused.append(f"{page.name}:{option.line}: `{option.text}` is no option of {', '.join(commands) or '?'}")
    assert not refused, "\n".join(refused)


def takes(module: str, words: tuple[str, ...]) -> bool:
    """Whether a command takes an option; one without its value stands for any value."""
    given = (*positional(module), *words)
    return parse_command(module, given) is None or parse_command(module, (*given, "1")) is None


def positional(module: str) -> tuple[str, ...]:
    """What a command cannot do without."""
    return ("FOLDER",) if module == "experiments.validate_recording" else ()


def test_an_unknown_option_and_an_unknown_value_are_refused():
    """The check itself: what no parser knows must not pass."""
    assert parse_command("experiments.train", ("--preset", "quick")) is None
    assert "--presett" in parse_command("experiments.train", ("--presett", "quick"))
    assert parse_command("experiments.walk", ("--engine", "bullet")) is not None
    assert (
        parse_command("iwalker_jax.commands.shared.console", ()) == "iwalker_jax.commands.shared.console is no command"
    )
    assert parse_command("experiments.nothing", ()) == "there is no module experiments.nothing"


@by_page
def test_shell_blocks_start_known_programs_and_extras_exist(page):
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    for command, line in shell_lines(page):
        words = command.split()
        assert words[0] in PROGRAMS, f"{page.name}:{line}: {words[0]}"
        if words[0] == "python" and words[1] != "-m":
            assert (ROOT / words[1]).is_file(), f"{page.name}:{line}: there is no {words[1]}"
        for word in words[1:]:
            if words[0] == "pip" and "[" in word:
                named = word.strip("'\"").partition("[")[2].rstrip("]").split(",")
                assert set(named) <= set(extras), f"{page.name}:{line}: {word}"


@by_page
def test_blocks_say_their_language(page):
    assert {block.language for block in fenced_blocks(page)} <= LANGUAGES


@by_page
def test_every_name_in_code_exists(page):
    missing = [name for name in sorted(dotted_names(page)) if not exists(name)]
    assert not missing, f"{page.name} names what does not exist: {', '.join(missing)}"


def exists(dotted: str) -> bool:
    """Whether a dotted name is a module, or can be reached from one; `iw` is the front door."""
    parts = ["iwalker_jax" if part == "iw" else part for part in dotted.split(".")]
    length = max(k for k in range(1, len(parts) + 1) if k == 1 or is_module(".".join(parts[:k])))
    if length == len(parts):
        return True
    found: Any = importlib.import_module(".".join(parts[:length]))
    for part in parts[length:]:
        if not hasattr(found, part) and part not in getattr(found, "__dataclass_fields__", {}):
            return False
        found = getattr(found, part, None)
    return True


def is_module(dotted: str) -> bool:
    """Whether there is a module of this name, which is not imported."""
    try:
        return importlib.util.find_spec(dotted) is not None
    except ModuleNotFoundError:
        return False


@by_page
def test_named_files_links_and_pictures_exist(page):
    missing = [name for name in named_files(page) if not (ROOT / name).exists()]
    for link in relative_links(page):
        file, _, anchor = link.partition("#")
        target = page.parent / file if file else page
        if not target.exists() or (anchor and anchor not in headings(target)):
            missing.append(link)
    assert not missing, f"{page.name} points at what does not exist: {', '.join(missing)}"


@by_page
def test_tests_named_in_code_are_there(page):
    """`tests/file.py::test_name` names a test that pytest finds in that file."""
    for name in named_tests(page):
        file, _, test = name.partition("::")
        found = (ROOT / file).is_file() and f"\ndef {test}(" in (ROOT / file).read_text(encoding="utf-8")
        assert found, f"{page.name} names what is no test: {name}"


def test_every_row_of_the_derivatives_names_function_and_test():
    rows = [row for row in (ROOT / "docs" / "gradients.md").read_text(encoding="utf-8").splitlines() if " -> " in row]
    rows = [row for row in rows if row.startswith("| ") and not row.startswith("| from -> to")]
    assert len(rows) > 20
    for row in rows:
        _, _, _, function, test, _ = row.split("|")
        assert "`iwalker_jax." in function and "`tests/" in test and "::test_" in test, row


def test_what_the_changelog_says_is_there_now_is_there():
    """The second column of its tables of what moved: modules that exist and options that their commands take."""
    moved = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("### Moved")[1].split("\n## ")[0]
    rows = [row.split("|")[2] for row in moved.splitlines() if row.startswith("| `")]
    spans = [span for row in rows for span in re.findall(r"`((?:iwalker_jax|experiments)\.[^`]+)`", row)]
    assert spans
    for span in spans:
        name, *words = span.split()
        assert exists(name), f"there is no {name}"
        assert not words or takes(name, tuple(words)), f"{name} does not take {' '.join(words)}"


def test_the_table_of_commands_holds_every_experiment():
    readme = ROOT / "README.md"
    rows = [line for line in readme.read_text(encoding="utf-8").splitlines() if line.startswith("| `python -m")]
    named = {row.split("`")[1].split()[2] for row in rows}
    assert {name for name in named if name.startswith("experiments.")} == commands_in("experiments")


def test_the_readme_shows_every_example():
    shown = {Path(name).name for name in named_files(ROOT / "README.md") if name.startswith("examples/")}
    assert shown == {file.name for file in (ROOT / "examples").glob("*.py")}


def test_every_benchmark_and_page_is_named_somewhere():
    named = {command.module for page in PAGES for command in module_commands(page)}
    named |= {name for page in PAGES for name in dotted_names(page)}
    assert commands_in("benchmarks") <= named
    linked = {(page.parent / link.partition("#")[0]).resolve() for page in PAGES for link in relative_links(page)}
    assert {file for file in (ROOT / "docs").iterdir() if file.suffix in (".md", ".png")} <= linked


def test_the_floors_of_the_page_are_those_of_the_house():
    """The table of rooms against the one that the imports are held to, floor by floor."""
    table = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").split("| floor | rooms |")[1]
    rows = [row for row in table.split("\n\n")[0].splitlines() if "`" in row]
    floors = [{Path(name).stem for name in re.findall(r"`([\w/.]+)`", row)} for row in rows]
    assert floors == [set(floor) for floor in reversed(FLOORS)]


@pytest.mark.parametrize(
    ("page", "title", "words"),
    [
        ("navigation", "policy", set(POLICIES)),
        ("navigation", "outcome", {end.word for end in Outcome} - {Outcome.RUNNING.word}),
        ("qp", "status", {status.name for status in Status}),
        ("choosing", "mode", set(get_args(GradientMode))),
        ("choosing", "preset", set(PRESETS)),
    ],
)
def test_tables_of_choices_are_complete(page, title, words):
    """The first column of a page's table against the library's own list."""
    table = (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8").split(f"\n| {title} |")[1].split("\n\n")[0]
    column = [row.split("|")[1].strip(" `") for row in table.splitlines()[2:]]
    assert {word.removesuffix(" (default)").strip("` ") for word in column} == words


def test_the_readme_is_short():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.encode()) <= 8192


@by_page
def test_lines_of_text_can_be_read_side_by_side(page: Path):
    """120 characters, but for rows of tables, which cannot be broken."""
    lines = page.read_text(encoding="utf-8").splitlines()
    long = [number for number, line in enumerate(lines, start=1) if len(line) > 120 and not line.startswith("|")]
    assert not long, f"{page.name}: lines {long}"
