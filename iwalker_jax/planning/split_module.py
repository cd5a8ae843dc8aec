"""A network as a pytree: parameters are its leaves, its structure is static; so it passes through `jit` and `vmap`."""

from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import jax
from flax import nnx

Network = TypeVar("Network", bound=nnx.Module)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SplitModule(Generic[Network]):
    """Parameters and structure of a network, apart.

    Attributes:
        params: an nnx state; the pytree's leaves.
        graph: the structure without arrays; static, so another one compiles anew.
    """

    params: Any
    graph: nnx.GraphDef = field(metadata={"static": True})

    def merge(self) -> Network:
        """The network, to be called."""
        return nnx.merge(self.graph, self.params)

    def with_params(self, params: Any) -> "SplitModule[Network]":
        """The same structure with other parameters."""
        return replace(self, params=params)


def split_module(network: Network) -> SplitModule[Network]:
    """Parameters and structure of a network all of whose variables are parameters."""
    graph, params = nnx.split(network, nnx.Param)
    return SplitModule(params, graph)
