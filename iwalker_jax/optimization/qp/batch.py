"""Lays a batch of quadratic programs out so that a CPU works on many at once."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array

from iwalker_jax.optimization.qp.core import solve_core
from iwalker_jax.optimization.qp.settings import QpSettings
from iwalker_jax.optimization.qp.verdicts import QpIterate

CHUNK = 16  # problems side by side: two vectors of eight, and their tableaux still fit the second-level cache
_ALL: Any = QpIterate(*[True] * len(QpIterate._fields))  # type: ignore[arg-type]


def solve_batched(settings: QpSettings, *data: Array) -> QpIterate:
    """`solve_core` of one problem; under vmap, chunks of problems side by side in the last axis."""
    return _single(settings)(*data)


@cache
def _single(settings: QpSettings) -> jax.custom_batching.custom_vmap:
    solve = jax.custom_batching.custom_vmap(lambda *data: solve_core(settings, *data))

    @solve.def_vmap
    def rule(size: int, batched: list[bool], *data: Array) -> tuple[QpIterate, Any]:
        return _many(settings)(*_spread(size, batched, data)), _ALL

    return solve


@cache
def _many(settings: QpSettings) -> jax.custom_batching.custom_vmap:
    solve = jax.custom_batching.custom_vmap(lambda *data: _in_chunks(data, settings))

    @solve.def_vmap
    def rule(size: int, batched: list[bool], *data: Array) -> tuple[QpIterate, Any]:
        flat = [a.reshape(-1, *a.shape[2:]) for a in _spread(size, batched, data)]
        answer = solve(*flat)
        unflat = jax.tree.map(lambda a: a.reshape(size, -1, *a.shape[1:]), answer)
        return unflat, _ALL

    return solve


def _spread(size: int, batched: list[bool], data: tuple[Array, ...]) -> list[Array]:
    return [a if b else jnp.broadcast_to(a, (size, *a.shape)) for a, b in zip(data, batched)]


def _in_chunks(data: tuple[Array, ...], settings: QpSettings) -> QpIterate:
    size = data[0].shape[0]
    width = min(CHUNK, size)
    count = -(-size // width)

    def chunk(part: tuple[Array, ...]) -> QpIterate:
        answer = solve_core(settings, *(jnp.moveaxis(a, 0, -1) for a in part))
        answer = answer._replace(pivots=jnp.broadcast_to(answer.pivots, (width,)))
        return QpIterate(*(jnp.moveaxis(a, -1, 0) for a in answer))

    if count == 1:
        return chunk(data)
    if count * width > size:
        rows = jnp.minimum(jnp.arange(count * width), size - 1)  # the last problem fills the last chunk
        data = tuple(a[rows] for a in data)
    parts = tuple(a.reshape(count, width, *a.shape[1:]) for a in data)
    answer = jax.lax.map(chunk, parts)
    return jax.tree.map(lambda a: a.reshape(count * width, *a.shape[2:])[:size], answer)
