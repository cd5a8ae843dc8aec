"""The documentation as a site: it builds without a warning, holds every public name, and needs no network.

The oracle of what is public is Python's import of every package and its `__all__`; the site's own pages are made from
the source, which they do not import.
"""

import importlib
import os
import pkgutil
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import bruce_model
import iwalker_jax
from tests.docs.pages import ROOT

pytest.importorskip("mkdocs")

_FETCHED = re.compile(r'<(?:script|img|iframe|source)\b[^>]*\bsrc="([^"]+)"|<link\b[^>]*\bhref="([^"]+)"')
_EQUATION_ROWS = re.compile(r"^## .*: equation to function$.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as the pages say, in a folder of its own."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    ended = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=500)
    assert ended.returncode == 0, ended.stderr[-3000:]
    assert "WARNING" not in ended.stderr, ended.stderr[-3000:]
    return folder


def public_names() -> set[str]:
    """Every name in the `__all__` of a package, as users import it."""
    names: set[str] = set()
    for front in (iwalker_jax, bruce_model):
        inner = pkgutil.walk_packages(front.__path__, f"{front.__name__}.")
        for package in (front.__name__, *(module.name for module in inner if module.ispkg)):
            names |= {f"{package}.{name}" for name in getattr(importlib.import_module(package), "__all__", ())}
    return names


def test_every_public_name_has_an_entry(site):
    pages = "".join(page.read_text(encoding="utf-8") for page in sorted((site / "api").glob("*.html")))
    anchors = set(re.findall(r'\bid="([\w.]+)"', pages))
    names = public_names()
    assert len(names) > 300
    assert names <= anchors, f"not in the site: {', '.join(sorted(names - anchors))}"


def test_every_name_is_described_once(site):
    for page in sorted((site / "api").glob("*.html")):
        anchors = re.findall(r'\bid="([^"]+)"', page.read_text(encoding="utf-8"))
        twice = {anchor for anchor, count in Counter(anchors).items() if count > 1}
        assert not twice, f"{page.name}: {', '.join(sorted(twice))}"


def test_every_function_of_an_equation_is_a_link(site):
    sections = _EQUATION_ROWS.findall((ROOT / "docs" / "architecture.md").read_text(encoding="utf-8"))
    functions = {name for section in sections for name in re.findall(r"`(iwalker_jax\.[\w.]+)`", section)}
    page = (site / "architecture.html").read_text(encoding="utf-8")
    linked = re.findall(r'<a [^>]*href="(api/\w+\.html)#([\w.]+)"[^>]*><code>([\w.]+)</code></a>', page)
    assert len(functions) > 40
    assert functions <= {name for _, _, name in linked}
    for file, anchor, _ in linked:
        assert f'id="{anchor}"' in (site / file).read_text(encoding="utf-8")


def test_formulas_are_drawn(site):
    """Every formula is MathML; none is left to a script."""
    pages = {page.name: page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    assert not [name for name, text in pages.items() if 'class="arithmatex"' in text]
    assert pages["architecture.html"].count("<math") > 30
    assert pages["hlip_steps.html"].count("<math") > 5


def test_nothing_is_fetched_from_a_network(site):
    pages = sorted(site.rglob("*.html"))
    fetched = {(page, link) for page in pages for pair in _FETCHED.findall(page.read_text("utf-8")) for link in pair}
    fetched = {(page, link) for page, link in fetched if link and not link.startswith("data:")}
    assert fetched
    assert not [link for _, link in fetched if re.match(r"(https?:)?//", link)]
    missing = [
        (page.name, link) for page, link in fetched if page.name != "404.html" and not (page.parent / link).exists()
    ]
    assert not missing


def test_it_can_be_searched_without_a_server(site):
    """The index is a script, which pages that are opened as files may load; names and titles are in it."""
    index = (site / "search" / "search_index.js").read_text(encoding="utf-8")
    assert index.startswith("var __index = ")
    assert "iwalker_jax.optimization.qp.solver.solve_qp" in index
    assert "iframe-worker.js" in (site / "index.html").read_text(encoding="utf-8")


def test_the_site_says_its_version(site):
    assert f"iwalker-jax {iwalker_jax.__version__}" in (site / "index.html").read_text(encoding="utf-8")
