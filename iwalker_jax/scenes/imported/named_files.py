"""Files of a scene, and those that they name: none may be a pipe, socket or device, whose reader would never end.

The readers, MuJoCo's and trimesh's, open whatever a file names, so that names are looked at beforehand.
"""

import html
import json
import os
import re
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import unquote

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.reading import printable, read_bytes

_MOST_BYTES = 1 << 30
_MODELS = (".xml", ".mjcf")
_ATTRIBUTE = r"\s*=\s*(?:\"([^\"]*)\"|'([^']*)')"
_FILE = re.compile(r"\bfile\w*" + _ATTRIBUTE)
_FOLDER = re.compile(r"\b(?:asset|mesh|texture)dir" + _ATTRIBUTE)


def require_file(file: Path, kind: str) -> None:
    """Refuse a path at which no regular file lies.

    Raises:
        InputError: with the path.
    """
    if not os.path.isfile(file):
        raise InputError(f"There is no file {printable(file, 300)}; give the path of {kind}.")


def check_model_files(file: Path) -> None:
    """Look at all that an MJCF model names, and at what the models among that name.

    Raises:
        InputError: for a model that cannot be read, or one that names a pipe, socket or device.
    """
    waiting, seen = [file], set()
    while waiting:
        model = waiting.pop()
        if model.resolve() in seen:
            continue
        seen.add(model.resolve())
        text = _text(file, model)
        folders = {place / name for place in (file.parent, model.parent) for name in ("", *_values(_FOLDER, text))}
        for name in _values(_FILE, text):
            places = [folder / name for folder in folders]
            _check_regular(file, name, places)
            waiting += [place for place in places if place.suffix.lower() in _MODELS and os.path.isfile(place)]


def check_gltf_files(file: Path) -> None:
    """Look at all that a .gltf file names.

    Raises:
        InputError: for a file that cannot be read, or one that names a pipe, socket or device.
    """
    try:
        content = json.loads(_text(file, file))
        uris = [part["uri"] for kind in ("buffers", "images") for part in content.get(kind, []) if "uri" in part]
    except (ValueError, TypeError, AttributeError, RecursionError):
        return  # which its reader says in its own words
    for uri in uris:
        if isinstance(uri, str) and not uri.startswith("data:"):
            _check_regular(file, uri, [file.parent / uri, file.parent / unquote(uri)])


def _text(file: Path, part: Path) -> str:
    try:
        return read_bytes(part, _MOST_BYTES).decode("latin-1")
    except InputError as error:
        raise InputError(f"{file} cannot be read: {printable(part, 300)} {error}") from error


def _values(attribute: re.Pattern[str], text: str) -> Iterable[str]:
    return [html.unescape(first or second) for first, second in attribute.findall(text)]


def _check_regular(file: Path, name: str, places: Iterable[Path]) -> None:
    for place in places:
        # Unlike a Path's own methods these say no to what is no file's name.
        if os.path.exists(place) and not os.path.isfile(place) and not os.path.isdir(place):
            raise InputError(f"{file} names {printable(name)}, a pipe, socket or device; name regular files alone.")
