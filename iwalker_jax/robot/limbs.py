"""Linear algebra of matrices with the pattern of a robot's mass matrix: limbs that couple to the base but not to
each other. Arrays carry the batch as the last axes (see batching.py); limbs are padded to the longest.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.robot.batching import batch_last

BASE = 6
"""Velocities of the floating base, which come first."""


@dataclass(frozen=True)
class Limbs:
    """The pattern.

    Attributes:
        starts, sizes: where each limb's velocities start in the velocity vector, and how many they are.
        contacts: the limb that each possible contact touches.
    """

    starts: tuple[int, ...]
    sizes: tuple[int, ...]
    contacts: tuple[int, ...] = ()

    @property
    def touching(self) -> tuple[int, ...]:
        """Limbs that can touch something."""
        return tuple(sorted(set(self.contacts)))

    @property
    def width(self) -> int:
        """Velocities of the longest limb."""
        return max(self.sizes)


class LimbVector(NamedTuple):
    """A vector by parts: base (6, *b) and limbs (limbs, width, *b), padded with zeros."""

    base: Float[Array, " 6 *b"]
    limbs: Float[Array, "limbs width *b"]


class LimbMatrix(NamedTuple):
    """A symmetric matrix by parts: base (6, 6, *b), limbs (limbs, width, width, *b), padded with the identity, and
    coupling (limbs, width, 6, *b), padded with zeros.
    """

    base: Float[Array, "6 6 *b"]
    coupling: Float[Array, "limbs width 6 *b"]
    limbs: Float[Array, "limbs width width *b"]


def split_vector(limbs: Limbs, vector: Float[Array, " n *b"]) -> LimbVector:
    """A vector by parts."""
    parts = [pad(vector[s : s + n], limbs.width - n, 1) for s, n in zip(limbs.starts, limbs.sizes, strict=True)]
    return LimbVector(vector[:BASE], jnp.stack(parts))


def join_vector(limbs: Limbs, vector: LimbVector) -> Float[Array, " n *b"]:
    """The vector of its parts."""
    return jnp.concatenate([vector.base] + [vector.limbs[k, :n] for k, n in enumerate(limbs.sizes)])


def split_matrix(limbs: Limbs, matrix: Float[Array, "n n *b"]) -> LimbMatrix:
    """A matrix by parts; entries between limbs are not read."""
    coupling, blocks = [], []
    for s, n in zip(limbs.starts, limbs.sizes, strict=True):
        missing = limbs.width - n
        coupling.append(pad(matrix[s : s + n, :BASE], missing, 1))
        block = pad(matrix[s : s + n, s : s + n], missing, 2)
        filler = jnp.diag(jnp.arange(limbs.width) >= n).astype(matrix.dtype)
        blocks.append(block + filler.reshape(filler.shape + (1,) * (matrix.ndim - 2)))
    return LimbMatrix(matrix[:BASE, :BASE], jnp.stack(coupling), jnp.stack(blocks))


def multiply(matrix: LimbMatrix, vector: LimbVector) -> LimbVector:
    """Matrix times vector; the padding of the vector stays as it is."""
    base, limbs = jnp.zeros_like(vector.base), jnp.zeros_like(vector.limbs)
    for k in range(BASE):
        base = base + matrix.base[:, k] * vector.base[k]
        limbs = limbs + matrix.coupling[:, :, k] * vector.base[k]
    for j in range(matrix.limbs.shape[1]):
        limbs = limbs + matrix.limbs[:, :, j] * vector.limbs[:, j, None]
        for limb in range(matrix.limbs.shape[0]):
            base = base + matrix.coupling[limb, j] * vector.limbs[limb, j]
    return LimbVector(base, limbs)


def solve(matrix: LimbMatrix, right: LimbVector) -> LimbVector:
    """Solve a positive definite system: eliminate each limb, then the base from the Schur complement."""
    width = matrix.limbs.shape[1]
    work = jnp.concatenate([matrix.limbs, matrix.coupling, right.limbs[:, :, None]], axis=2)
    reduced = _eliminate(jnp.moveaxis(work, 0, 2), width)[:, width:]
    schur = jnp.concatenate([matrix.base, right.base[:, None]], axis=1)
    for limb in range(matrix.limbs.shape[0]):
        for j in range(width):
            schur = schur - matrix.coupling[limb, j][:, None] * reduced[j, :, limb][None]
    base = _eliminate(schur, BASE)[:, BASE]
    limbs = reduced[:, BASE]
    for k in range(BASE):
        limbs = limbs - reduced[:, k] * base[k]
    return LimbVector(base, jnp.moveaxis(limbs, 1, 0))


def solve_symmetric(limbs: Limbs, matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    """Solve a positive definite system with the pattern; differentiable, and any `vmap` puts its axis last."""
    solver = batch_last(lambda m, r: join_vector(limbs, solve(split_matrix(limbs, m), split_vector(limbs, r))))
    return jax.lax.custom_linear_solve(lambda x: matrix @ x, right, lambda _, b: solver(matrix, b), symmetric=True)


def _eliminate(work: Float[Array, "n m *b"], size: int) -> Float[Array, "n m *b"]:
    """Gauss-Jordan elimination without pivots of the first `size` columns."""
    index = jnp.arange(size).reshape((size,) + (1,) * (work.ndim - 1))

    def step(k: Array, work: Array) -> Array:
        row = jax.lax.dynamic_index_in_dim(work, k, 0)
        row = row / jax.lax.dynamic_index_in_dim(row, k, 1)
        column = jax.lax.dynamic_index_in_dim(work, k, 1)
        return jnp.where(index == k, row, work - column * row)

    return jax.lax.fori_loop(0, size, step, work)


def pad(array: Float[Array, "..."], missing: int, axes: int) -> Float[Array, "..."]:
    """Zeros after the end of the first `axes` axes."""
    return jnp.pad(array, [(0, missing)] * axes + [(0, 0)] * (array.ndim - axes)) if missing else array
