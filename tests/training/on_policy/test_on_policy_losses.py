"""What candidates cost on the true scene: signs, derivatives, and that standing or going astray is never cheap."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.planning import MemoryIPath
from iwalker_jax.surrogate import TrueFields
from iwalker_jax.training.on_policy import OnPolicyConfig, PathWeights, candidate_losses, proposal_loss
from tests.gradients import assert_gradients_agree
from tests.surrogate.scenes import fields
from tests.training.on_policy.visits import CONFIG, NETWORK, visit_of


def fan(count=16):
    """Straight paths of 1.2 m in all directions."""
    angles = jnp.arange(count) * 2 * jnp.pi / count
    steps = jnp.linspace(0.24, 1.2, 5)[:, None]
    return steps * jnp.stack([jnp.cos(angles), jnp.sin(angles)], axis=-1)[:, None]


def test_the_cheapest_of_many_directions_leads_towards_the_goal_and_the_dearest_into_things():
    """Oracle: the way left to the goal at the ends, and the scene's own clearance along the paths."""
    losses = jax.jit(lambda visit: candidate_losses(CONFIG, fields(), visit, fan()))
    made = fields()
    for seed in range(6):
        visit = visit_of(seed)
        cost, touches = losses(visit)
        assert np.isfinite(cost).all()
        best, worst = int(np.argmin(cost)), int(np.argmax(cost))
        assert not bool(touches[best]) or bool(touches.all())
        # No path is cheaper than the best way, but for what grids round off.
        assert float(cost[best]) > -0.15
        assert float(cost[worst]) > 1.0
    assert made is fields()


def test_costs_have_the_derivatives_of_differences():
    """Oracle: central differences in double precision."""
    with jax.enable_x64(True):
        visit, made = visit_of(0), fields()
        wide = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float64), (made.scenes, made.goals))
        wider = TrueFields(
            wide[0], jnp.asarray(made.clearance, jnp.float64), wide[1], jnp.asarray(made.to_go, jnp.float64)
        )
        visit = visit._replace(
            view=visit.view._replace(goal=visit.view.goal.astype(jnp.float64)),
            origin=visit.origin.astype(jnp.float64),
            axis=visit.axis.astype(jnp.float64),
        )
        curved = fan(3).astype(jnp.float64) + jnp.asarray([0.01, 0.07]) * jnp.arange(5.0)[:, None]
        assert_gradients_agree(lambda ways: candidate_losses(CONFIG, wider, visit, ways).cost, curved, tolerance=2e-4)


def test_turning_round_costs_what_the_weight_says():
    """Oracle: the difference between a robot that faces the path and one that faces away from it."""
    visit = visit_of(1)
    away = visit._replace(view=visit.view._replace(goal=jnp.array([0.0, 0.0, -1.0, 0.0])))
    facing, turned = (candidate_losses(CONFIG, fields(), one, fan(1)).cost[0] for one in (visit, away))
    np.testing.assert_allclose(turned - facing, CONFIG.weights.turn, atol=1e-4)


def test_only_the_best_candidate_learns_when_nothing_is_spread():
    """Oracle: the gradient of the loss in the proposals' own outputs."""
    network = MemoryIPath(NETWORK, nnx.Rngs(0))
    visits = jax.tree.map(lambda *rows: jnp.stack(rows), *[visit_of(seed) for seed in range(4)])
    graph, params = nnx.split(network, nnx.Param)
    sharp = dataclasses.replace(CONFIG, weights=dataclasses.replace(CONFIG.weights, temperature=1e-6, tracking=0.0))

    def loss(params, spread):
        return proposal_loss(nnx.merge(graph, params), sharp, fields(), visits, spread)[0]

    concentrated = jax.grad(loss)(params, jnp.asarray(0.0))
    spread = jax.grad(loss)(params, jnp.asarray(1.0))
    for gradient in (concentrated, spread):
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    proposals = NETWORK.proposals

    def learning(gradient):
        bias = np.asarray(gradient["last"]["bias"][...]).reshape(proposals, -1)
        return (np.abs(bias[:, :-1]).max(axis=1) > 0).sum()

    assert learning(concentrated) <= learning(spread) == proposals


def test_weights_that_cannot_be_are_refused():
    """Oracle: the stated ranges."""
    with pytest.raises(InputError, match="not negative"):
        PathWeights(turn=-1.0)
    with pytest.raises(InputError, match="temperature"):
        PathWeights(temperature=0.0)
    with pytest.raises(InputError, match="batch"):
        OnPolicyConfig(robots=1, steps=1)
    with pytest.raises(InputError, match="explore"):
        OnPolicyConfig(explore=2.0)
