"""Views of remembered maps, for tests of what reads them."""

import jax
import jax.numpy as jnp

from iwalker_jax.planning import MapCell, MapView, MapViewParameters


def even_view(sizes: MapViewParameters, goal: list[float], cell: MapCell = MapCell.UNSEEN) -> MapView:
    """The same everywhere, before the first path: `goal` says how far the goal is and where the robot heads."""
    fine = jnp.full((sizes.bearings, sizes.samples), cell, jnp.int8)
    wide = jnp.full((sizes.bearings, sizes.wide_samples), cell, jnp.int8)
    return MapView(fine, wide, jnp.zeros_like(wide), jnp.asarray([*goal, 0.0, 0.0]))


def random_views(sizes: MapViewParameters, count: int, seed: int = 0) -> MapView:
    """Maps of noise."""
    fine, wide, visits, goal = jax.random.split(jax.random.key(seed), 4)
    shape, wider = ((count, sizes.bearings, samples) for samples in (sizes.samples, sizes.wide_samples))
    return MapView(
        jax.random.randint(fine, shape, 0, 3).astype(jnp.int8),
        jax.random.randint(wide, wider, 0, 3).astype(jnp.int8),
        jax.random.randint(visits, wider, 0, sizes.most_visits + 1).astype(jnp.int8),
        jax.random.uniform(goal, (count, 6), minval=-1.0),
    )
