"""Pages of the site that are made, not written: the front page, the notebooks and the API of every public name.

A name is public if it stands in the `__all__` of a package. What is written of it is its docstring, read without
importing anything.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import griffe
from griffe import Module
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PACKAGES = ("iwalker_jax", "bruce_model")
COPIED = {
    "index.md": "README.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "bruce_model/PROVENANCE.md": "bruce_model/PROVENANCE.md",
}
"""Pages of the site that lie elsewhere in the project."""

HOUSE_STYLE = str(Path(__file__).with_name("docstrings.py"))
Item = griffe.Object | griffe.Alias
NOTEBOOKS = "experiments/notebooks"
_DOTTED = re.compile(r"(?<![\[`])`((?:iw|iwalker_jax|bruce_model)(?:\.\w+)+)(?:\([^`\n]*\))?`")
_NOTEBOOK = re.compile(rf"\]\(\.\./{NOTEBOOKS}/(\w+)\.ipynb\)")
_FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """MkDocs: the version in the title, and in the navigation what its list need not repeat."""
    version = re.search(r'__version__ = "(.+)"', (ROOT / "iwalker_jax" / "version.py").read_text(encoding="utf-8"))
    assert version is not None
    config.site_name = f"{config.site_name} {version[1]}"
    config.extra["api"] = Api()
    pages = config.extra["api"].pages
    config.nav.append({"API": [{text.partition("\n")[0].strip("# `"): path} for path, text in pages.items()]})
    parts = {title: part for entry in config.nav for title, part in entry.items()}
    parts["Notebooks"] += [f"notebooks/{name}.md" for name in _NOTEBOOK.findall(text_of("notebooks.md"))]
    listed = str(config.nav)
    parts["Guides"] += [page.name for page in sorted(DOCS.glob("*.md")) if f"'{page.name}'" not in listed]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """MkDocs: adds what is copied and what is made."""
    for path, source in COPIED.items():
        files.append(File.generated(config, path, content=(ROOT / source).read_text(encoding="utf-8")))
    for notebook in sorted((ROOT / NOTEBOOKS).glob("*.ipynb")):
        settings = {"output_files_dir": notebook.stem, "unique_key": notebook.stem}
        text, resources = MarkdownExporter().from_filename(str(notebook), resources=settings)
        files.append(File.generated(config, f"notebooks/{notebook.stem}.md", content=text))
        for name, picture in resources["outputs"].items():
            files.append(File.generated(config, f"notebooks/{name}", content=picture))
    for path, text in config.extra["api"].pages.items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, **_: Any) -> str:
    """MkDocs: links of the project's folders as those of the site; names in code lead to their descriptions."""
    if page.file.src_uri.startswith(("api/", "notebooks/")):
        return markdown
    markdown = _NOTEBOOK.sub(r"](notebooks/\1.md)", markdown.replace("](docs/", "]("))
    pieces = _FENCE.split(markdown)
    pieces[::2] = [_DOTTED.sub(config.extra["api"].linked, piece) for piece in pieces[::2]]
    return "".join(pieces)


def text_of(page: str) -> str:
    """A page of docs/."""
    return (DOCS / page).read_text(encoding="utf-8")


class Api:
    """Pages of the API by path: the front door, a page a room, and what the pages of docs/ name besides."""

    def __init__(self) -> None:
        self.loader = griffe.GriffeLoader(extensions=griffe.load_extensions(HOUSE_STYLE), search_paths=[str(ROOT)])
        front, *beside = (self.loader.load(name) for name in PACKAGES)
        self.loader.resolve_aliases()
        self.described: set[str] = set()
        rooms = [*(room for _, room in sorted(front.modules.items()) if room.exports), *beside]
        pages = {f"api/{room.name}.md": self.page(*faces(room)) for room in rooms}
        self.pages = {"api/index.md": self.page(front), **pages, "api/inside.md": self.inside()}

    def page(self, face: Module, *inner: Module) -> str:
        """The faces of one room, each with its names; a name is described where it stands first."""
        parts = [f"# `{face.path}`", *self.face(face)]
        for other in inner:
            parts += [f"## `{other.path}`", *self.face(other)]
        return "\n\n".join(parts) + "\n"

    def face(self, face: Module) -> Iterator[str]:
        """What a package says of itself, the table of its names, and descriptions that stand nowhere yet."""
        assert face.docstring is not None and face.exports is not None
        items = [(f"{face.path}.{name}", meant(face[name])) for name in sorted(map(str, face.exports))]
        rows = [
            f"| {anchor(path, item)}[`{item.name}`][{item.canonical_path}] | {summary(item)} |" for path, item in items
        ]
        yield face.docstring.value
        yield "\n".join(["| name | |", "| --- | --- |", *rows])
        yield from self.entries(item.canonical_path for _, item in items)

    def inside(self) -> str:
        """What the pages name in code and no room shows: functions of an equation, for one."""
        text = "".join(text_of(page.name) for page in sorted(DOCS.glob("*.md")))
        found = [self.find(dotted) for dotted in sorted(set(_DOTTED.findall(text)))]
        paths = [item.canonical_path for item in found if item is not None]
        wanted = [path for path in paths if not self.anchor_of(path)]
        return "\n\n".join(["# Inside the rooms", "What the pages name besides.", *self.entries(wanted)]) + "\n"

    def entries(self, paths: Iterable[str]) -> Iterator[str]:
        """Descriptions of those that have none yet."""
        for path in paths:
            if path not in self.described:
                self.described.add(path)
                yield f"::: {path}"

    def find(self, dotted: str) -> Item | None:
        """What a dotted name of a page means; None for modules and for what is assigned while running."""
        try:
            item = meant(self.loader.modules_collection[re.sub(r"^iw\.", "iwalker_jax.", dotted)])
            return None if item.is_module else item
        except (KeyError, griffe.AliasResolutionError):
            return None

    def anchor_of(self, path: str) -> str | None:
        """The described name that a canonical path belongs to: itself, or the class that it is a member of."""
        owner = path.rpartition(".")[0]
        return path if path in self.described else owner if owner in self.described else None

    def linked(self, code: re.Match[str]) -> str:
        """Code of a page as a link to its description, if there is one."""
        item = self.find(code[1])
        target = self.anchor_of(item.canonical_path) if item is not None else None
        return f"[{code[0]}][{target}]" if target else code[0]


def faces(package: Module) -> Iterator[Module]:
    """A package and those inside it that show names."""
    if package.exports and package.filepath.name == "__init__.py":
        yield package
    for _, inner in sorted(package.modules.items()):
        if not inner.is_alias:
            yield from faces(inner)


def meant(item: Item) -> Item:
    """A function or class instead of the module of the same name that it is imported from."""
    return item[item.name] if item.is_module and item.name in item.members else item


def anchor(path: str, item: Item) -> str:
    """A target for links by the name that users import, which is not where it is written."""
    return "" if path == item.canonical_path else f'<span id="{path}"></span>'


def summary(item: Item) -> str:
    """The first sentence of a docstring, fit for a cell of a table."""
    text = " ".join(item.docstring.value.partition("\n\n")[0].split()) if item.docstring else ""
    return text.partition(". ")[0].rstrip(".").replace("|", r"\|")
