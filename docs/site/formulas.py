"""Formulas of the pages as MathML, which browsers draw themselves: no script and no network."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """MkDocs: the formulas that arithmatex has marked in a page's HTML, drawn."""
    return _FORMULA.sub(_mathml, content)


def _mathml(formula: re.Match[str]) -> str:
    return convert(html.unescape(formula[2]), display="inline" if formula[1] == "span" else "block")
