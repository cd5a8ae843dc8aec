"""The project's pages read as data: fenced blocks, commands, names in code, links and pictures."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
"""The pages that speak of the present; the changelog also names what is gone."""

PACKAGES = ("iwalker_jax", "experiments", "benchmarks", "bruce_model")

_FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_DOTTED = re.compile(rf"(?:iw|{'|'.join(PACKAGES)})(?:\.[A-Za-z_]\w*)+")


class Block(NamedTuple):
    """A fenced block: its language, text and the line of its first line of text."""

    language: str
    text: str
    line: int


class ModuleCommand(NamedTuple):
    """A `python -m module arguments` of a page, and the line that it stands on."""

    module: str
    arguments: tuple[str, ...]
    line: int

    def __str__(self) -> str:
        return shlex.join(["python", "-m", self.module, *self.arguments])


class OptionSpan(NamedTuple):
    """A `--option value` alone in code, and the commands that its paragraph or table row names."""

    text: str
    commands: tuple[ModuleCommand, ...]
    line: int


def fenced_blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page."""
    text = page.read_text(encoding="utf-8")
    return [Block(m[1], m[2], _line(text, m.start(2))) for m in _FENCE.finditer(text)]


def shell_lines(page: Path) -> list[tuple[str, int]]:
    """(command, line) of every shell block: continued lines joined, comments and blank lines left out."""
    found = []
    for block in fenced_blocks(page):
        if block.language not in ("bash", "sh", "shell", "console"):
            continue
        pending, start = "", block.line
        for number, line in enumerate(block.text.splitlines(), start=block.line):
            start = start if pending else number
            pending += line.removesuffix("\\")
            if not line.endswith("\\"):
                found += [(part, start) for part in _commands_of(pending)]
                pending = ""
    return found


def module_commands(page: Path) -> list[ModuleCommand]:
    """Every command of a page that starts a Python module, in blocks and in the text."""
    in_blocks = [_module_command(shlex.split(command), line) for command, line in shell_lines(page)]
    in_text = [command for paragraph in _paragraphs(page) for command in _commands_named(*paragraph)]
    return [command for command in (*in_blocks, *in_text) if command is not None]


def option_spans(page: Path) -> list[OptionSpan]:
    """Every option that stands in code by itself; its commands are those of its paragraph, else of the page."""
    all_commands = tuple(module_commands(page))
    found = []
    for text, line in _paragraphs(page):
        own = tuple(_commands_named(text, line)) or all_commands
        found += [OptionSpan(span, own, line) for span in _SPAN.findall(text) if span.startswith("--")]
    return found


def dotted_names(page: Path) -> set[str]:
    """Every dotted name of this project in code: modules, functions, classes and attributes."""
    return {name for name in (span.split("(")[0] for span in _code_spans(page)) if _DOTTED.fullmatch(name)}


def named_files(page: Path) -> set[str]:
    """Every file or folder of this project that a page names in code."""
    tops = {path.name for path in ROOT.iterdir() if path.is_dir()} - {"runs"}
    found = {span for span in _code_spans(page) if re.fullmatch(r"[\w.\-]+(/[\w.\-]*)+", span)}
    return {span for span in found if span.split("/")[0] in tops}


def named_tests(page: Path) -> set[str]:
    """Every test that a page names in code as pytest does."""
    return {span for span in _code_spans(page) if re.fullmatch(r"tests/[\w/]+\.py::\w+", span)}


def relative_links(page: Path) -> set[str]:
    """Targets of links and pictures that are no web addresses."""
    return {link for link in _LINK.findall(_without_blocks(page)) if not link.startswith(("http://", "https://"))}


def headings(page: Path) -> set[str]:
    """The anchors of a page's headings, as web pages of repositories make them."""
    titles = re.findall(r"^#+ (.+)$", _without_blocks(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def _code_spans(page: Path) -> list[str]:
    """All code in the text of a page."""
    return [span for text, _ in _paragraphs(page) for span in _SPAN.findall(text)]


def _line(text: str, position: int) -> int:
    return text.count("\n", 0, position) + 1


def _without_blocks(page: Path) -> str:
    """The text of a page with its fenced blocks blanked, so that lines keep their numbers."""
    return _FENCE.sub(lambda m: "\n" * m[0].count("\n"), page.read_text(encoding="utf-8"))


def _paragraphs(page: Path) -> list[tuple[str, int]]:
    """(text, line) of every paragraph, list item and table row."""
    found: list[tuple[str, int]] = []
    open_paragraph = False
    for number, line in enumerate(_without_blocks(page).splitlines(), start=1):
        starts = line.startswith(("|", "- ", "* ", "#")) or re.match(r"\d+\. ", line) is not None
        if not line.strip():
            open_paragraph = False
        elif open_paragraph and not starts:
            found[-1] = (f"{found[-1][0]} {line.strip()}", found[-1][1])
        else:
            found.append((line, number))
            open_paragraph = not line.startswith("|")
    return found


def _commands_named(text: str, line: int) -> list[ModuleCommand]:
    """Commands among the code of a paragraph: `python -m module ...` or a module with its options."""
    found = []
    for span in _SPAN.findall(text):
        words = shlex.split(span, comments=True)
        if words and _DOTTED.fullmatch(words[0]) and len(words) > 1:
            words = ["python", "-m", *words]
        found.append(_module_command(words, line))
    return [command for command in found if command is not None]


def _module_command(words: list[str], line: int) -> ModuleCommand | None:
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words = words[1:]
    if words[:2] != ["python", "-m"] or len(words) < 3:
        return None
    return ModuleCommand(words[2], tuple(words[3:]), line)


def _commands_of(line: str) -> list[str]:
    """The commands of a shell line: without its comment, divided at `&&`."""
    words = shlex.split(line, comments=True)
    parts: list[list[str]] = [[]]
    for word in words:
        if word == "&&":
            parts.append([])
        else:
            parts[-1].append(word)
    return [shlex.join(part) for part in parts if part]
