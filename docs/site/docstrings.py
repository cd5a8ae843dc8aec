"""The house's docstrings as the site's parser reads them: names that share a line, and units in brackets."""

import re
from typing import Any

import griffe

_SECTION = re.compile(r"^( *)(?:Args|Attributes):\n((?:\1 +.*\n?|\n)+)", re.MULTILINE)
_SHARED = re.compile(r"^( +)(\w+(?:, \w+)+): (.*(?:\n\1 +.*)*)", re.MULTILINE)
_CODE = re.compile(r"(`+[^`]*`+)")


class HouseStyle(griffe.Extension):
    """`low, high: bounds [m].` becomes an entry a name, and `[m]` no link."""

    def on_instance(self, *, obj: griffe.Object, **_: Any) -> None:
        """Griffe: rewrites the docstring of whatever has one."""
        if obj.docstring:
            text = _SECTION.sub(lambda section: _SHARED.sub(_entries, section[0]), obj.docstring.value)
            pieces = _CODE.split(text)
            pieces[::2] = [piece.replace("[", r"\[") for piece in pieces[::2]]
            obj.docstring.value = "".join(pieces)


def _entries(shared: re.Match[str]) -> str:
    """One entry for each of the names that share a description."""
    return "\n".join(f"{shared[1]}{name}: {shared[3]}" for name in shared[2].split(", "))
