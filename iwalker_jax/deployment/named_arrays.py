"""Pytrees as named arrays: `memory.gait.swing.position` instead of the 7th leaf, so that others can address them."""

from collections.abc import Mapping
from typing import Any, TypeVar

import jax

Tree = TypeVar("Tree")


def named_arrays(tree: Any, prefix: str = "") -> dict[str, Any]:
    """The leaves of a pytree of tuples and dataclasses by their fields' names, joined by dots, in the tree's order."""
    leaves = jax.tree_util.tree_flatten_with_path(tree)[0]
    return {".".join(([prefix] if prefix else []) + [_part(key) for key in path]): leaf for path, leaf in leaves}


def from_named(template: Tree, arrays: Mapping[str, Any], prefix: str = "") -> Tree:
    """The pytree of a template's structure whose leaves have these names; KeyError for a missing one."""
    names = named_arrays(template, prefix)
    return jax.tree.unflatten(jax.tree.structure(template), [arrays[name] for name in names])


def _part(key: Any) -> str:
    for kind in ("name", "key", "idx"):
        if hasattr(key, kind):
            return str(getattr(key, kind))
    raise TypeError(f"a leaf without a name: {key!r}")
