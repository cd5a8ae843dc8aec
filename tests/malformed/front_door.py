"""Calls by the library's front door with one argument broken: refused in a sentence, answered by a status, or right.

What only looks odd, a list or numbers of another kind, must give what the same numbers give in single precision, and
whatever is said to be solved must satisfy an oracle of its own.
"""

import contextlib
import functools
import io
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

import iwalker_jax as iw
from iwalker_jax.optimization import StepReach
from tests.malformed import front_door_oracles as oracles
from tests.malformed.kinds import Kind
from tests.malformed.sentences import is_no_sentence

Arguments = dict[str, Any]

OTHER_THINGS: tuple[Any, ...] = (None, "text", b"bytes", {"a": 1}, object(), [], [[1, 2], [3]], 1 + 2j, np.array(["x"]))
"""What is no array of numbers."""

OTHER_TYPES = ("float64", ">f4")
"""In which the same numbers may come to every function, without compiling it anew."""

HUGE = (1e38, -1e38, 1e-42, 1e20, -1e20, 3e9)
"""Numbers that single precision holds and their squares are too large or too small for."""


@dataclass(frozen=True)
class Door:
    """A function by the front door.

    Attributes:
        call: with the arguments by name.
        arguments: of a call that is fine.
        arrays: names of those that are arrays of numbers.
        oracle: of an answer that is said to be right.
        poison: entries that no array of the call may hold.
        others: broken values of the other arguments, by name.
        lengthy: arrays that may have more rows or fewer.
        other_types: in which the same numbers may come too, rounded if need be; each is compiled for.
        tolerance: of equal results.
    """

    call: Callable[..., Any]
    arguments: Arguments
    arrays: tuple[str, ...]
    oracle: oracles.Oracle
    poison: tuple[float, ...] = (np.nan, np.inf, -np.inf)
    others: dict[str, tuple[Any, ...]] = field(default_factory=dict)
    lengthy: tuple[str, ...] = ()
    other_types: tuple[str, ...] = ()
    tolerance: float = 1e-3


def solved(P: Any, q: Any, C: Any, low: Any, high: Any, **others: Any) -> Any:
    """A program made and solved."""
    return iw.solve_qp(iw.QuadraticProgram(P, q, C, low, high), **others)


def is_plain(value: Any) -> bool:
    """Whether a value is an array of numbers that JAX takes as an argument."""
    return isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "fiub" and value.dtype.isnative


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, compiled once for arrays; of what is none the checks are run, and no value comes of it.

    Called as it is, a solver would be compiled anew for every case.
    """

    @functools.cache
    def program(names: tuple[str, ...], values: tuple[Any, ...]) -> Callable[..., Any]:
        return jax.jit(lambda arrays: function(**arrays, **dict(zip(names, values, strict=True))))

    def call(**arguments: Any) -> Any:
        arrays = {name: value for name, value in arguments.items() if is_plain(value)}
        others = {name: value for name, value in arguments.items() if name not in arrays}
        try:
            known = program(tuple(others), tuple(others.values()))
        except TypeError:  # lists and the like
            return jax.eval_shape(lambda: function(**arguments))
        return known(arrays)

    return call


def looked_at(function: Callable[..., Any]) -> Callable[..., Any]:
    """`compiled`, after the function's own look at values, which it cannot have at those of an argument of `jit`."""
    known = compiled(function)

    def call(**arguments: Any) -> Any:
        jax.eval_shape(lambda: function(**arguments))
        return known(**arguments)

    return call


@functools.cache
def planner() -> Any:
    return iw.load_planner()


@functools.cache
def doors() -> dict[str, Door]:
    """All of them."""
    rng = np.random.default_rng(0)
    A = rng.normal(size=(4, 4))
    path = np.stack([np.linspace(0, 2, 20), 0.1 * np.sin(np.linspace(0, 3, 20))], axis=1).astype(np.float32)
    state = np.array([0.0, 0.0, 0.1, 0.0], np.float32)
    steps = np.stack([0.08 * np.arange(1, 7), 0.05 * (-1.0) ** np.arange(6)], axis=1).astype(np.float32)
    weights = np.array([1.0, 1000.0, 5000.0], np.float32)
    gait = np.array([[0.0, 0.0, 0.3], [0.0, -0.05, 0.0]], np.float32)
    grid = iw.GridSpec(0.0, -1.0, 0.1, 20, 20)
    depth = np.full((90, 160), 2.0, np.float32)
    millimetres = (depth * 1000, (depth * 1000).astype(np.uint16), depth.astype(np.int32), depth[:, :100])
    degrees = np.array([0.58, 15.0, 0.0, 0.0, 0.0], np.float32)
    no_feet, nowhere = np.float32([np.nan, np.inf, 0.5, 0.0]), tuple(np.float32([[np.inf, 0.0], [0.0, -np.inf]]))
    modes = ("gradient", ("Implicit", "", 3, None))
    program = {
        "P": (A @ A.T + np.eye(4)).astype(np.float32), "q": np.ones(4, np.float32),
        "C": rng.normal(size=(3, 4)).astype(np.float32), "low": np.full(3, -1.0, np.float32),
        "high": np.full(3, 1.0, np.float32),
    }  # fmt: skip
    return {
        "solve_qp": Door(
            compiled(solved), program, tuple(program), oracles.optimal_program, (np.nan,), dict([modes]),
        ),
        "solve_unicycle": Door(
            compiled(iw.solve_unicycle), {"reference": path, "initial_state": state, "weights": weights},
            ("reference", "initial_state"), oracles.tracked_path, lengthy=("reference",), tolerance=0.05,
            others={"weights": (-weights, 0 * weights, np.nan * weights, weights[:2], "x"), **dict([modes])},
        ),
        "solve_step_mpc": Door(
            compiled(iw.solve_step_mpc), {"footsteps": steps, "initial_state": gait}, ("footsteps", "initial_state"),
            oracles.summed_steps, others=dict([modes]), lengthy=("footsteps",), other_types=("int32", "float16"),
        ),
        "solve_bounded_step_mpc": Door(
            compiled(iw.solve_bounded_step_mpc),
            {"footsteps": steps, "initial_state": gait, "stance": np.float32(1.0), "reach": StepReach()},
            ("footsteps", "initial_state"), oracles.summed_steps, lengthy=("footsteps",),
            others={"stance": (*no_feet, "left", [1.0, 1.0]), "headings": ([0.0], "x"), **dict([modes])},
        ),
        "signed_distance_field": Door(
            compiled(iw.signed_distance_field), {"occupied": rng.random((20, 20)) < 0.1, "resolution": 0.1},
            ("occupied",), oracles.exact_distances, lengthy=("occupied",),
            others={"resolution": (np.nan, np.inf, -0.1, 0.0, "x", None, [0.1, 0.1])},
        ),
        "cost_to_go": Door(
            compiled(iw.cost_to_go),
            {"traversal_cost": np.ones((20, 20), np.float32), "goal_xy": np.float32([1.0, 0.5]), "grid": grid},
            ("traversal_cost", "goal_xy"), oracles.shortest_routes, (np.nan,),
            {"max_rounds": (0, -1, np.nan, "x"), "grid": (None, (20, 20)), "goal_xy": nowhere},
        ),
        "build_local_map": Door(
            looked_at(iw.build_local_map),
            {"depth": depth, "mount": np.asarray(iw.CameraMount().as_array()), "intrinsics": iw.Intrinsics()},
            ("depth", "mount"), oracles.one_kind_of_cell, (),
            {
                "depth": millimetres, "mount": (np.full(5, np.nan), degrees, np.full(5, np.inf)),
                "intrinsics": (None, (160, 90), iw.Intrinsics(100, 90)), "soft": ("x", 0.1, True),
            },
        ),
        "planner": Door(
            lambda **arguments: planner()(**arguments), {"depth": depth, "goal": np.array([2.0, 0.5], np.float32)},
            ("depth", "goal"), oracles.plan_from_here, (),
            {
                "depth": millimetres, "mount": (degrees.tolist(), [np.nan] * 5, [0.58], "x"),
                "state": ((1.0, 2.0), "x", iw.RobotState(np.full(2, np.nan), np.zeros(2), np.ones(()), np.zeros(()))),
            },
        ),
    }  # fmt: skip


def wrong_shape(value: np.ndarray, lengthy: bool, rng: np.random.Generator) -> Any:
    """The same numbers in a shape that fits nothing."""
    ways = [value[None, None], value[..., None], value.ravel()[:0], np.zeros((), value.dtype)]
    ways += [] if lengthy else [value[:-1]]
    ways += [value.ravel()] if value.ndim > 1 else []
    return ways[rng.integers(len(ways))]


def of_type(value: np.ndarray, kind: str) -> np.ndarray:
    """The numbers in another type, rounded to it."""
    return np.round(value).astype(kind) if kind == "int32" else value.astype(kind)


def broken_array(door: Door, name: str, rng: np.random.Generator) -> tuple[str, Arguments, str]:
    """(what is broken, arguments, what must come of it: `refused`, `same` as the same numbers, or `right`)."""
    value = np.asarray(door.arguments[name])
    way = int(rng.integers(7))
    expected = "refused"
    if way == 0 and door.poison and value.dtype != bool:
        entry = float(rng.choice(door.poison))
        what, changed = f"{entry} in {name}", with_entry(value, entry, rng)
    elif way <= 1:
        changed = wrong_shape(value, name in door.lengthy, rng)
        what = f"{name} of shape {np.shape(changed)}"
    elif way == 2:
        changed = OTHER_THINGS[rng.integers(len(OTHER_THINGS))]
        what = f"{name} is {changed!r:.20}"
    elif way == 3:
        what, changed, expected = f"{name} as a list", value.tolist(), "same"
    elif way == 4 and value.dtype != bool:
        kind = str(rng.choice([*OTHER_TYPES, *door.other_types]))
        others = {other: of_type(np.asarray(door.arguments[other]), kind) for other in door.arrays}
        return f"all as {kind}", door.arguments | others, "same"
    elif value.dtype == bool:
        share = float(rng.choice([0.0, 0.02, 0.5, 0.98, 1.0]))
        what, changed, expected = f"{name} with {share:.0%} occupied", rng.random(value.shape) < share, "right"
    elif way <= 5 and (door.poison or rng.random() < 0.5):
        entry = float(rng.choice(HUGE))
        what, changed, expected = f"{entry} in {name}", with_entry(value, entry, rng), "right"
    elif door.poison:
        scale = np.float32(rng.choice([0.0, -1.0, 1e-20, 1e12]))
        what, changed, expected = f"{name} times {scale}", value.astype(np.float32) * scale, "right"
    else:
        entry = float(rng.choice([np.nan, np.inf, -np.inf, -3.0, 1e30]))
        what, changed, expected = f"{entry} in {name}", with_entry(value, entry, rng), "right"
    return what, door.arguments | {name: changed}, expected


def with_entry(value: np.ndarray, entry: float, rng: np.random.Generator) -> np.ndarray:
    """One number replaced."""
    changed = np.array(value, np.float32)
    changed.ravel()[rng.integers(changed.size)] = entry
    return changed


def broken_call(door: Door, rng: np.random.Generator) -> tuple[str, Arguments, str]:
    """(what is broken, arguments, what must come of it)."""
    if door.others and rng.random() < 0.25:
        names = list(door.others)
        name = names[rng.integers(len(names))]
        value = door.others[name][rng.integers(len(door.others[name]))]
        return f"{name} is {value!r:.40}", door.arguments | {name: value}, "refused"
    return broken_array(door, door.arrays[rng.integers(len(door.arrays))], rng)


def is_finite(value: Any) -> bool:
    """Whether all floating-point numbers in a result are finite."""
    leaves = [np.asarray(leaf) for leaf in jax.tree.leaves(value)]
    return all(np.isfinite(leaf).all() for leaf in leaves if leaf.dtype.kind == "f")


def is_close(first: Any, second: Any, tolerance: float) -> bool:
    """Whether two results are the same but for rounding."""
    pairs = zip(jax.tree.leaves(first), jax.tree.leaves(second), strict=True)
    return all(np.allclose(np.float64(a), np.float64(b), rtol=tolerance, atol=tolerance) for a, b in pairs)


def usual(value: Any) -> np.ndarray:
    """The numbers of an argument as they would usually be given."""
    array = np.asarray(value)
    return array if array.dtype == bool else array.astype(np.float32)


def knock(name: str, rng: np.random.Generator, folder: Path) -> str | None:
    """Call a function with something broken; what is wrong with its answer."""
    door = doors()[name]
    what, arguments, expected = broken_call(door, rng)
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            found = jax.block_until_ready(door.call(**arguments))
    except iw.InputError as error:
        wrong = is_no_sentence(str(error))
        return wrong and f"{what}: {wrong}"
    except Exception as error:
        raise RuntimeError(f"{what}: {type(error).__name__}: {error}") from error
    if any(isinstance(leaf, jax.ShapeDtypeStruct) for leaf in jax.tree.leaves(found)):
        return f"{what}: taken for right" if expected == "refused" else None
    found = jax.device_get(found)
    value = found.value if isinstance(found, iw.Solution) else found
    if isinstance(found, iw.Solution) and int(found.status) != iw.Status.CONVERGED:
        return None if is_finite(value) else f"{what}: not finite, status {int(found.status)}"
    if not is_finite(value):
        return f"{what}: not finite, and nothing said"
    if expected == "refused":
        return f"{what}: taken for right"
    plain = arguments | {array: usual(arguments[array]) for array in door.arrays}
    if expected == "same":
        right = jax.device_get(door.call(**plain))
        if not is_close(value, right.value if isinstance(right, iw.Solution) else right, door.tolerance):
            return f"{what}: another result than of the same numbers in single precision"
    wrong = door.oracle(plain, value)
    return wrong and f"{what}: {wrong}"


def prepare() -> None:
    """Compile every function once, for the types that are taken as they are."""
    for door in doors().values():
        for kind in (OTHER_TYPES[0], *door.other_types):
            arrays = {name: np.asarray(door.arguments[name]) for name in door.arrays}
            known = {name: array if array.dtype == bool else of_type(array, kind) for name, array in arrays.items()}
            with contextlib.suppress(iw.InputError):
                jax.block_until_ready(door.call(**door.arguments | known))


NAMES = ("solve_qp", "solve_unicycle", "solve_step_mpc", "solve_bounded_step_mpc", "signed_distance_field",
         "cost_to_go", "build_local_map", "planner")  # fmt: skip
KINDS: dict[str, Kind] = {name: partial(knock, name) for name in NAMES}
