"""How the settings of the surrogate walk, of the network with a memory and of its training act."""

import dataclasses
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
from flax import nnx

from iwalker_jax.navigation.memory import (
    SCAN_MEMORY,
    ViewPoint,
    WideMemoryParameters,
    empty_memory,
    empty_wide_memory,
    update_wide_memory,
    view_map,
)
from iwalker_jax.perception import ScanParameters, TraversalParameters, range_scan
from iwalker_jax.planning import MapCell, MapViewParameters, MemoryIPath, MemoryIPathConfig, choose_path
from iwalker_jax.surrogate import (
    FieldParameters,
    SurrogateParameters,
    Visit,
    make_fields,
    start_surrogate,
    surrogate_step,
)
from iwalker_jax.training.on_policy import OnPolicyConfig, PathWeights, proposal_loss
from iwalker_jax.training.on_policy.loop import boldness, first_state, make_adam, practice_scenes
from tests.planning.views import even_view
from tests.settings.mechanism import Probe
from tests.settings.robot_probes import MOUNT, SMALL, depth_image
from tests.surrogate.scenes import CALM, GRIDS, fields, start
from tests.training.on_policy.visits import NETWORK, visit_of

TINY = OnPolicyConfig(network=NETWORK, grids=GRIDS, scenes=1, robots=2, steps=2, rounds=2, epochs=1, batch=2, clip=0.5)
ROUND = (
    *("robots", "steps", "rounds", "epochs", "batch", "seed"),
    *("learning_rate", "weight_decay", "clip", "explore", "spread"),
)
PLACES = ("extent", "resolution", "cost_resolution")


@cache
def network() -> MemoryIPath:
    return MemoryIPath(NETWORK, nnx.Rngs(0))


def viewed(parameters: MapViewParameters) -> Any:
    """An empty map as seen, and what a network of that view says of it."""
    base = jnp.asarray([0.1, 0.2, 0.3])
    memory = empty_memory(SCAN_MEMORY, base[:2])
    wide = empty_wide_memory(WideMemoryParameters(), SCAN_MEMORY, memory)
    at = ViewPoint(base, jnp.asarray([1.0, 1.5]), jnp.asarray([0.6, 0.8]))
    view, _ = view_map(parameters, SCAN_MEMORY, memory, wide, at)
    return view, MemoryIPath(dataclasses.replace(NETWORK, view=parameters), nnx.Rngs(0))(view)


def proposed(config: MemoryIPathConfig) -> Any:
    """Candidates on a free map, and the one that is chosen."""
    view = even_view(config.view, [0.1, 0.9, 0.8, 0.6], MapCell.FREE)
    candidates = MemoryIPath(config, nnx.Rngs(0))(view)
    return candidates, choose_path(config, candidates, view)


def visited(parameters: WideMemoryParameters) -> Any:
    """The wide map of a robot that has moved on by more and by less than the way between two visits."""
    memory = empty_memory(SCAN_MEMORY, jnp.zeros(2))
    wide = empty_wide_memory(parameters, SCAN_MEMORY, memory)
    return [update_wide_memory(parameters, SCAN_MEMORY, wide, memory, jnp.asarray([x, 0.0])) for x in (0.1, 0.3)]


def stepped(parameters: SurrogateParameters) -> Any:
    """A start, and one step of a walk."""
    first = start_surrogate(parameters, GRIDS, fields(), jax.random.key(0))
    return surrogate_step(parameters, GRIDS, network(), fields(), first, jnp.asarray(0.1))


@cache
def visits() -> Visit:
    """The same place over and over."""
    return jax.tree.map(lambda leaf: jnp.stack([leaf] * 16), visit_of(0))


def judged(config: OnPolicyConfig) -> Any:
    """The losses of a batch."""
    return proposal_loss(MemoryIPath(config.network, nnx.Rngs(0)), config, fields(), visits(), jnp.asarray(0.1))


def taught(config: OnPolicyConfig) -> Any:
    """What decides how parameters follow their gradients, and how bold robots are, in the second round."""
    adam, params = make_adam(config), {"weight": jnp.asarray(0.3)}
    state = adam.init(params)
    for _ in range(config.robots * config.steps * config.epochs // config.batch):
        updates, state = adam.update({"weight": jnp.asarray(2.0)}, state, params)
    return updates, boldness(config, jnp.asarray(1)), first_state(config, fields()).robots.true


def prepare() -> None:
    """Make what probes share before any of them is traced."""
    network(), fields(), start(0, CALM), visits()


PROBES = {
    ScanParameters: (Probe(lambda c: range_scan(depth_image(), MOUNT, SMALL, c), ScanParameters(), followed=False),),
    MapViewParameters: (Probe(viewed, NETWORK.view, followed=False, changes={"bearings": 14}),),
    WideMemoryParameters: (Probe(visited, WideMemoryParameters(), changes={"cells": 98}),),
    MemoryIPathConfig: (Probe(proposed, NETWORK, followed=False),),
    FieldParameters: (
        Probe(lambda c: (c.grid, c.cost_grid), FieldParameters(), traced=False, only=PLACES),
        Probe(
            lambda c: make_fields(1, 0, c),
            FieldParameters(goals=1),
            changes={"goal_clearance": 0.5},
            traced=False,
            only=("goals", "goal_clearance", "traversal"),
        ),
    ),
    SurrogateParameters: (Probe(stepped, SurrogateParameters()),),
    PathWeights: (Probe(lambda c: judged(dataclasses.replace(TINY, weights=c)), PathWeights()),),
    OnPolicyConfig: (
        Probe(
            judged,
            TINY,
            only=("network", "robot", "grids", "unicycle", "weights"),
            changes={
                "network": dataclasses.replace(NETWORK, hidden=24),
                "robot": SurrogateParameters(body_radius=0.3),
                "grids": dataclasses.replace(GRIDS, traversal=TraversalParameters(contact=10.0)),
            },
            followed=False,
        ),
        Probe(taught, TINY, only=ROUND, followed=False),
        Probe(lambda c: practice_scenes(c).goals.shape, TINY, traced=False, only=("scenes",)),
    ),
}
