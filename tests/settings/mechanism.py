"""Which fields of a configuration act: changed one at a time, or followed through a traced program."""

import contextlib
import copy
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.interpreters import partial_eval

from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class Probe:
    """How the fields of one configuration class are seen to act.

    Attributes:
        outcome: what follows from a configuration: a tree of arrays, numbers and strings.
        base: the configuration whose fields are changed, one at a time.
        changes: other values, for fields that the rule of `other_value` would not take to something sensible.
        refused: other values that are refused, with words of the sentence.
        traced: `outcome` is a pure JAX function: programs are compared instead of numbers, so that nothing is compiled.
        followed: floats are even followed through one such program; not where a class must be hashable.
        only: the fields that this probe is about; all if left out.
    """

    outcome: Callable[[Any], Any]
    base: Any
    changes: Mapping[str, Any] = field(default_factory=dict)
    refused: Mapping[str, tuple[Any, str]] = field(default_factory=dict)
    traced: bool = True
    followed: bool = True
    only: tuple[str, ...] | None = None


def other_value(value: Any) -> Any:
    """Another value of the same kind: a float a tenth larger, the next whole number, the other truth, ..."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return 1.1 * value if value else 0.1
    if isinstance(value, tuple):
        return tuple(other_value(part) for part in value)
    if dataclasses.is_dataclass(value):
        for part in dataclasses.fields(value):
            before = getattr(value, part.name)
            if not isinstance(before, str | Path | None):
                with contextlib.suppress(InputError):
                    return dataclasses.replace(value, **{part.name: other_value(before)})
    raise AssertionError(f"give another value for {value!r} in the probe's changes")


def idle_fields(probe: Probe) -> list[str]:
    """Fields of a probe whose change neither changes the outcome nor is refused."""
    names = [f.name for f in dataclasses.fields(probe.base) if probe.only is None or f.name in probe.only]
    refused = [name for name in names if name in probe.refused and _is_refused(probe, name)]
    followed: set[str] = set()
    idle = []
    if probe.traced and probe.followed:
        followed = {name for name in names if type(getattr(probe.base, name)) is float} - set(probe.changes)
        idle = [name for name in _unused(probe, sorted(followed)) if name not in refused]
    rest = [name for name in names if name not in followed and name not in refused]
    compare = _program if probe.traced else _values
    before = compare(probe.outcome, probe.base) if rest else None
    for name in rest:
        value = probe.changes.get(name, ...)
        changed = dataclasses.replace(
            probe.base, **{name: other_value(getattr(probe.base, name)) if value is ... else value}
        )
        if compare(probe.outcome, changed) == before:
            idle.append(name)
    return idle


def _is_refused(probe: Probe, name: str) -> bool:
    value, words = probe.refused[name]
    try:
        probe.outcome(dataclasses.replace(probe.base, **{name: value}))
    except InputError as error:
        return words in str(error)
    return False


def _unused(probe: Probe, names: list[str]) -> list[str]:
    """Floats that the outcome is no function of; validation is passed by, because it needs numbers."""

    def traced(values: list[Any]) -> Any:
        configuration = _hashable_copy(probe.base)
        for name, value in zip(names, values, strict=True):
            object.__setattr__(configuration, name, value)
        return probe.outcome(configuration)

    if not names:
        return []
    program = jax.make_jaxpr(traced)([float(getattr(probe.base, name)) for name in names]).jaxpr
    _, used = partial_eval.dce_jaxpr(program, [True] * len(program.outvars))
    return [name for name, acts in zip(names, used, strict=True) if not acts]


def _hashable_copy(configuration: Any) -> Any:
    """A copy that programs can take as a static argument even while it holds traced values."""
    kind = type(configuration)
    by_identity = type(kind.__name__, (kind,), {"__hash__": object.__hash__, "__eq__": object.__eq__})
    other = copy.copy(configuration)
    object.__setattr__(other, "__class__", by_identity)
    return other


def _program(outcome: Callable[[Any], Any], configuration: Any) -> tuple:
    """The program's text without what its results do not need, and its constants."""
    closed = jax.make_jaxpr(lambda: outcome(configuration))()
    live, _ = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(closed.jaxpr.outvars))
    return str(live), tuple(np.asarray(constant).tobytes() for constant in closed.consts if _is_array(constant))


def _values(outcome: Callable[[Any], Any], configuration: Any) -> tuple:
    """Every number of an outcome, exactly."""
    leaves, structure = jax.tree.flatten(outcome(configuration))
    return str(structure), tuple(
        leaf
        if isinstance(leaf, str)
        else (np.asarray(leaf).dtype.str, np.asarray(leaf).shape, np.asarray(leaf).tobytes())
        for leaf in leaves
    )


def _is_array(constant: Any) -> bool:
    return hasattr(constant, "dtype") and not jax.dtypes.issubdtype(constant.dtype, jax.dtypes.extended)


def idle_in_all(probes: Sequence[Probe]) -> list[str]:
    """Fields of a class that act in none of its probes; a field that no probe is about is idle too."""
    names = {f.name for f in dataclasses.fields(probes[0].base)}
    acting = set()
    for probe in probes:
        acting |= (set(probe.only) if probe.only is not None else names) - set(idle_fields(probe))
    return sorted(names - acting)
