"""A quadratic program as an object: made and checked at the boundary, printed, saved for a bug report, loaded again."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import no_type_check

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from iwalker_jax.arrays import as_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.files import read_npz, write_npz

Blocks = tuple[tuple[str, int], ...]


@partial(jax.tree_util.register_dataclass, data_fields=["P", "q", "C", "low", "high"], meta_fields=["blocks"])
@dataclass(frozen=True)
@no_type_check  # stacks have more axes, and JAX rebuilds trees with leaves that are no arrays
class QuadraticProgram:
    """min x'P x / 2 + q'x with low <= C x <= high; batched by vmap or a scan over its arrays.

    Attributes:
        P: (n, n) cost, symmetric positive semidefinite.
        q: (n,) linear cost.
        C: (m, n) constraint rows; m may be 0.
        low, high: (m,) bounds; equal for an equality, infinite for none.
        blocks: names and row counts of groups of rows, in order, e.g. (("friction", 20), ("torque", 10)); static.
    """

    P: Float[Array, "n n"]
    q: Float[Array, " n"]
    C: Float[Array, "m n"]
    low: Float[Array, " m"]
    high: Float[Array, " m"]
    blocks: Blocks = ()

    def __str__(self) -> str:
        """Sizes, scales, conditioning and kinds of rows, a line for each block."""
        P, q, C, low, high = self.arrays()
        if P.ndim != 2:
            return f"Quadratic programs stacked as {P.shape[:-2]}: {P.shape[-1]} variables, {C.shape[-2]} rows"
        eigenvalues = np.linalg.eigvalsh((P + P.T) / 2)
        lines = [
            f"Quadratic program, {len(q)} variables, {len(low)} rows, {P.dtype}",
            f"  cost: eigenvalues {eigenvalues[0]:.1e} to {eigenvalues[-1]:.1e}, |q| <= {np.max(np.abs(q)):.1e}",
        ]
        for name, rows in named_rows(self.blocks, len(low)):
            fixed = np.sum(low[rows] == high[rows])
            free = np.sum(np.isinf(low[rows]) & np.isinf(high[rows]))
            size = np.linalg.norm(C[rows], axis=1)
            spread = f"{size.min():.1e} to {size.max():.1e}" if len(size) else "none"
            lines.append(f"  {name}: {len(size)} rows, {fixed} equalities, {free} unbounded, row lengths {spread}")
        return "\n".join(lines)

    def arrays(self) -> tuple[np.ndarray, ...]:
        """P, q, C, low, high as NumPy arrays."""
        return tuple(np.asarray(a) for a in (self.P, self.q, self.C, self.low, self.high))

    def save(self, path: str | Path) -> None:
        """Write to an .npz file."""
        P, q, C, low, high = self.arrays()
        names = np.asarray([name for name, _ in self.blocks], dtype=str)
        counts = np.asarray([count for _, count in self.blocks], dtype=int)
        arrays = {"P": P, "q": q, "C": C, "low": low, "high": high, "block_names": names, "block_rows": counts}
        write_npz(Path(path), arrays)


def named_rows(blocks: Blocks, rows: int) -> list[tuple[str, slice]]:
    """Each block's rows; one block of everything if none are named."""
    result, start = [], 0
    for name, count in blocks or (("constraints", rows),):
        result.append((name, slice(start, start + count)))
        start += count
    return result


def load_program(path: str | Path) -> QuadraticProgram:
    """Read a program, or a stack of them, written by `QuadraticProgram.save`.

    Raises:
        InputError: if the file is missing or is no such file.
    """
    try:
        arrays = read_npz(Path(path), foreign=True)
    except InputError as error:
        raise InputError(f"{error}; give an .npz file of a quadratic program, with P, q, C, low and high.") from error
    try:
        fields = {name: arrays[name] for name in ("P", "q", "C", "low", "high")}
    except KeyError as error:
        raise InputError(
            f"{path} cannot be read as a quadratic program; give an .npz file with P, q, C, low and high."
        ) from error
    names, counts = np.ravel(arrays.get("block_names", ())), np.ravel(arrays.get("block_rows", ()))
    numbers = all(array.dtype.kind in "fiu" for array in fields.values())
    if not numbers or (len(counts) and counts.dtype.kind not in "iu"):
        raise InputError(f"{path} holds no real numbers where they are due; give P, q, C, low and high as numbers.")
    blocks = tuple((str(name), int(count)) for name, count in zip(names, counts))
    values = (jnp.asarray(value) for value in fields.values())
    return replace(QuadraticProgram(*values), blocks=blocks)  # type: ignore[arg-type]


def in_floats(problem: QuadraticProgram) -> QuadraticProgram:
    """The program in JAX arrays of one floating type, at least of single precision; works on tracers.

    Raises:
        InputError: on lists of uneven lengths, and on what is no real number.
    """
    names = ("P", "q", "C", "low", "high")
    arrays = {name: as_numbers(getattr(problem, name), name) for name in names}
    floats = [a.dtype for a in arrays.values() if jnp.issubdtype(a.dtype, jnp.floating)]
    dtype = jnp.result_type(jnp.float32, *floats) if floats else jnp.result_type(float)
    P, q, C, low, high = (arrays[name].astype(dtype) for name in names)
    return QuadraticProgram(P, q, C, low, high, problem.blocks)


def check_program_shapes(problem: QuadraticProgram) -> None:
    """Refuse shapes that do not fit together; works on tracers.

    Raises:
        InputError: with the shapes.
    """
    shapes = {name: jnp.shape(getattr(problem, name)) for name in ("P", "q", "C", "low", "high")}
    n = shapes["q"][0] if len(shapes["q"]) == 1 else 0
    m = shapes["C"][0] if len(shapes["C"]) == 2 else -1
    wanted = {"P": (n, n), "q": (n,), "C": (m, n), "low": (m,), "high": (m,)}
    if n == 0 or m < 0 or shapes != wanted:
        given = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise InputError(f"The program's shapes are {given}; give P (n, n), q (n,), C (m, n), low (m,), high (m,).")
    counted = sum(count for _, count in problem.blocks)
    if problem.blocks and (counted != m or any(count < 0 for _, count in problem.blocks)):
        raise InputError(f"The blocks {problem.blocks} name {counted} rows but C has {m}; name every row once.")


def quadratic_program(
    P: Float[ArrayLike, "n n"],
    q: Float[ArrayLike, " n"],
    C: Float[ArrayLike, "m n"] | None = None,
    low: Float[ArrayLike, " m"] | None = None,
    high: Float[ArrayLike, " m"] | None = None,
    blocks: Iterable[tuple[str, int]] = (),
) -> QuadraticProgram:
    """Make a program from concrete arrays and check all that can be checked; inside jit use the class itself.

    Args:
        P, q, C, low, high, blocks: as in `QuadraticProgram`; no C means no constraints, a missing bound infinity.

    Raises:
        InputError: on shapes that do not fit, NaN, low > high, or a P that is not symmetric or not semidefinite.
    """
    kind = np.float32  # of what is left out, which shall not widen the rest
    C = np.zeros((0, np.size(q)), kind) if C is None else C
    rows = np.shape(C)[0] if np.ndim(C) else 0
    low = np.full(rows, -np.inf, kind) if low is None else low
    high = np.full(rows, np.inf, kind) if high is None else high
    named = tuple((str(name), int(count)) for name, count in blocks)
    problem = in_floats(QuadraticProgram(P, q, C, low, high, named))  # type: ignore[arg-type]
    check_program_shapes(problem)
    check_program_values(problem)
    return problem


def check_program_values(problem: QuadraticProgram) -> None:
    """Refuse values no solver can do anything with; for concrete arrays.

    Raises:
        InputError: on NaN, infinite costs or rows, low > high, or a P that is not symmetric or not semidefinite.
    """
    P, q, C, low, high = problem.arrays()
    for name, array in {"P": P, "q": q, "C": C}.items():
        if not np.all(np.isfinite(array)):
            where = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise InputError(f"{name} is {array[where]} at {where}; give finite numbers.")
    for name, array, unusable in (("low", low, np.inf), ("high", high, -np.inf)):
        bad = np.isnan(array) | (array == unusable)
        if np.any(bad):
            row = int(np.flatnonzero(bad)[0])
            raise InputError(f"{name} is {array[row]} in row {row}; give a number, or {-unusable} for no bound.")
    if np.any(low > high):
        row = int(np.flatnonzero(low > high)[0])
        name = next((name for name, rows in named_rows(problem.blocks, len(low)) if rows.start <= row < rows.stop), "")
        raise InputError(f"low {low[row]} exceeds high {high[row]} in row {row} ({name}); swap or widen the bounds.")
    size = np.max(np.abs(P))
    tolerance = 100 * np.finfo(P.dtype).eps * size
    if np.max(np.abs(P - P.T)) > tolerance:
        i, j = np.unravel_index(np.argmax(np.abs(P - P.T)), P.shape)
        raise InputError(f"P is not symmetric: {P[i, j]} at ({i}, {j}) but {P[j, i]} at ({j}, {i}); use (P + P') / 2.")
    lowest = np.linalg.eigvalsh(P.astype(float))[0]
    if lowest < -len(q) * tolerance:
        raise InputError(f"P has the eigenvalue {lowest:.3g}, so the cost has no minimum; make it semidefinite.")
