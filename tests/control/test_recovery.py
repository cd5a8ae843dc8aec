"""A standing robot that tips starts to step; one that does not, stands."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.control.footstep_plan import make_plan
from iwalker_jax.control.gait import advance_gait, initial_gait
from iwalker_jax.control.gait_state import GaitMode, Posture
from iwalker_jax.control.parameters import GaitParameters
from iwalker_jax.control.stepping import stepping_gains

GAIT = GaitParameters()
NOBODYS_PLAN = make_plan(np.zeros((0, 2)), np.zeros(0), 1, 8)


@pytest.fixture(scope="module")
def tick():
    gains = stepping_gains(GAIT)
    return jax.jit(partial(advance_gait, GAIT, gains, 1.0, 0.002)), float(gains.rate)


def posture(divergent, rate: float, stagger: float = 0.0) -> Posture:
    """Feet 0.1 m apart, the left one ahead by `stagger`; the COM midway moves as its divergent component [m] says."""
    feet = jnp.asarray([[-stagger / 2, -0.05, 0.0], [stagger / 2, 0.05, 0.0]])
    velocity = jnp.asarray([*np.multiply(divergent, rate), 0.0], jnp.float32)
    return Posture(jnp.asarray([0.0, 0.0, 0.37]), velocity, feet, jnp.zeros(2), jnp.ones(2, bool))


@pytest.mark.parametrize(
    ("divergent", "stagger", "steps"),
    [
        ((0.0, 0.0), 0.0, False),
        ((0.03, 0.02), 0.0, False),
        ((0.06, 0.01), 0.0, True),
        ((-0.06, -0.01), 0.0, True),
        ((0.0, 0.06), 0.0, True),
        ((0.055, 0.04), 0.06, False),  # close to the foot that stands ahead
        ((0.055, -0.04), 0.06, True),  # far ahead of the other one
    ],
)
def test_steps_when_the_divergent_component_leaves_the_feet(tick, divergent, stagger, steps):
    advance, rate = tick
    before = initial_gait(GAIT, posture((0.0, 0.0), rate, stagger))
    after, reference = advance(posture(divergent, rate, stagger), NOBODYS_PLAN, before)
    assert int(after.mode) == (GaitMode.WALK if steps else GaitMode.STAND)
    if steps:
        loaded = int(divergent[1] > 0)
        assert int(after.stance) == loaded
        np.testing.assert_array_equal(reference.stance, [1 - loaded, loaded])


def test_a_plan_says_which_foot_steps_first(tick):
    advance, rate = tick
    plan = make_plan(np.array([[0.0, 0.05], [0.0, -0.05]]), np.zeros(2), 1, 8)
    before = initial_gait(GAIT, posture((0.0, 0.0), rate))
    after, _ = advance(posture((0.06, 0.01), rate), plan, before)
    assert (int(after.mode), int(after.stance)) == (GaitMode.WALK, 0)
