"""Batches as the last axis: the layout in which small matrix algebra runs as whole vectors over the batch."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp


def batch_last(function: Callable[..., Any]) -> Callable[..., Any]:
    """Make `vmap` hand its axis to `function` as the last one of every argument and result.

    The function must accept arrays with any number of trailing batch axes and treat each batch entry alone. It is not
    differentiable afterwards; wrap it in a rule of its own.
    """
    mapped = jax.custom_batching.custom_vmap(function)

    @mapped.def_vmap
    def _(size: int, batched: list[Any], *arguments: Any) -> tuple[Any, Any]:
        def move(array: jax.Array, is_batched: bool) -> jax.Array:
            if is_batched:
                return jnp.moveaxis(array, 0, -1)
            return jnp.broadcast_to(array[..., None], (*array.shape, size))

        result = mapped(*jax.tree.map(move, arguments, tuple(batched)))
        return jax.tree.map(lambda array: jnp.moveaxis(array, -1, 0), result), jax.tree.map(lambda _: True, result)

    return mapped
