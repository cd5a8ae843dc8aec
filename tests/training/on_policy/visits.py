"""Small networks and places where they looked, for the tests of on-policy training."""

import jax.numpy as jnp

from iwalker_jax.planning import MapViewParameters, MemoryIPathConfig
from iwalker_jax.surrogate import Visit
from iwalker_jax.training.on_policy import OnPolicyConfig
from tests.planning.views import even_view
from tests.surrogate.scenes import CALM, GRIDS, fields, start

NETWORK = MemoryIPathConfig(view=MapViewParameters(bearings=12, rings=4), channels=8, hidden=16, judging=8)
CONFIG = OnPolicyConfig(network=NETWORK, robot=CALM, grids=GRIDS, scenes=3, robots=4, steps=8, batch=16)


def visit_of(seed):
    """A robot that faces its goal: the view's x axis is its heading."""
    state = start(seed)
    offset = fields().goals[state.scene, state.goal] - state.true[:2]
    view = even_view(NETWORK.view, [0.0, 0.0, 1.0, 0.0])
    return Visit(view, state.true[:2], jnp.arctan2(offset[1], offset[0]), state.scene, state.goal)
