"""iPath with a memory: mirror equivariance by construction, lengths of its paths, and the choice among them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.planning import MapViewParameters, MemoryIPath, MemoryIPathConfig, PathCandidates, choose_path
from tests.planning.views import even_view, random_views

CONFIG = MemoryIPathConfig(view=MapViewParameters(bearings=12, rings=4), channels=8, hidden=32)


@pytest.fixture(scope="module")
def network():
    return MemoryIPath(CONFIG, nnx.Rngs(0))


def test_candidates_of_the_mirror_image_are_the_mirrored_candidates(network):
    """Oracle: the definition of equivariance; the two halves change places."""
    views = random_views(CONFIG.view, 20)
    here, there = network(views), network(views.mirrored())
    half = CONFIG.proposals
    flipped = there.waypoints * jnp.array([1.0, -1.0])
    for own, other in (
        (here.waypoints, flipped),
        (here.log_cost, there.log_cost),
        (here.fear, there.fear),
    ):
        np.testing.assert_allclose(own[:, :half], other[:, half:], atol=1e-5)
        np.testing.assert_allclose(own[:, half:], other[:, :half], atol=1e-5)


def test_no_path_is_a_point_unless_the_goal_is_reached(network):
    """Oracle: the bounds of the configuration; the third number of a view is the goal's distance, folded."""
    views = random_views(CONFIG.view, 50, 1)
    knots = jnp.concatenate([jnp.zeros((50, 2 * CONFIG.proposals, 1, 2)), network(views).waypoints], axis=2)
    lengths = np.linalg.norm(np.diff(knots, axis=2), axis=-1).sum(axis=-1)
    near = 0.5 * CONFIG.view.near_goal * (np.asarray(views.goal[:, 1]) + 1.0)
    assert (lengths >= np.minimum(near, CONFIG.shortest)[:, None] - 1e-5).all()
    assert (lengths <= CONFIG.longest + 1e-5).all()


def test_a_single_view_is_a_row_of_a_batch(network):
    """Oracle: the batch."""
    views = random_views(CONFIG.view, 3, 2)
    whole = network(views)
    one = network(jax.tree.map(lambda leaf: leaf[1], views))
    for a, b in zip(one, whole, strict=True):
        np.testing.assert_allclose(a, b[1], atol=1e-6)


def test_the_cheapest_is_chosen_and_of_equals_the_one_on_the_last_side():
    """Oracle: two straight paths, one to each side."""
    steps = jnp.linspace(0.2, 1.0, 5)[:, None]
    left, right = steps * jnp.array([1.0, 1.0]), steps * jnp.array([1.0, -1.0])

    def chosen(dearer, course, visits=0):
        """0 for the path to the left; the one to the right is dearer."""
        candidates = PathCandidates(jnp.stack([left, right]), jnp.log1p(jnp.array([1.0, 1.0 + dearer])), jnp.zeros(2))
        view = even_view(CONFIG.view, [0.0, 0.0, 1.0, 0.0])
        view = view._replace(goal=view.goal.at[4:].set(jnp.asarray(course)), visits=view.visits + jnp.int8(visits))
        return int(choose_path(CONFIG, candidates, view))

    unit = jnp.array([1.0, -1.0]) / jnp.sqrt(2.0)
    assert chosen(0.1, jnp.zeros(2)) == 0
    assert chosen(0.1, unit) == 1
    assert chosen(0.4, unit) == 0
    # Who has been here keeps to its side the longer.
    assert chosen(0.4, unit, visits=4) == 1


@pytest.mark.parametrize("layer", ["cells", "wide", "visits"])
def test_every_map_of_the_view_changes_what_the_network_says(network, layer):
    """Oracle: the same view with one map erased."""
    views = random_views(CONFIG.view, 4, 3)
    erased = views._replace(**{layer: jnp.zeros_like(getattr(views, layer))})
    before, after = network(views), network(erased)
    assert np.abs(before.waypoints - after.waypoints).max() > 1e-4
    assert np.abs(before.log_cost - after.log_cost).max() > 1e-3


def test_sizes_that_cannot_be_are_refused():
    """Oracle: the stated ranges."""
    with pytest.raises(InputError, match="hidden"):
        MemoryIPathConfig(hidden=0)
    with pytest.raises(InputError, match="reach"):
        MemoryIPathConfig(reach=99)
    with pytest.raises(InputError, match="shortest"):
        MemoryIPathConfig(shortest=2.0)
    with pytest.raises(InputError, match="bearings"):
        MapViewParameters(bearings=0)
    with pytest.raises(InputError, match="even number of bearings"):
        MapViewParameters(bearings=15)
    with pytest.raises(InputError, match="wide_spacing"):
        MapViewParameters(wide_spacing=3.0)
    with pytest.raises(InputError, match="near_goal"):
        MapViewParameters(near_goal=9.0)
