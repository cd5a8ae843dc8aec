"""Plans without a network, on frames of a test sequence: both lose to the planner that ships, in every metric."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.api.planner import load_with_config
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.frames import (
    REFERENCE_NAMES,
    ReferencePlanner,
    ShortfallCharge,
    charged,
    evaluate_sequence,
    frame_values,
    goal_routes,
    record_held_out_sequence,
)
from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS
from iwalker_jax.evaluation.frames.metrics import PlanMetrics
from iwalker_jax.planning import PlannerConfig, RobotState

STATE = RobotState(jnp.zeros((2, 2)), jnp.zeros((2, 2)), jnp.asarray([1.0, -1.0]), jnp.zeros(2))


@pytest.fixture(scope="module")
def figures():
    """Figures of the shipped planner and of both references on the corner's frames."""
    planner, config = load_with_config()
    sequence = record_held_out_sequence("corner", frames=16)
    routes = goal_routes(sequence)
    plans = {"shipped": planner, **{name: ReferencePlanner(name, planner.config) for name in REFERENCE_NAMES}}
    return {
        name: frame_values(evaluate_sequence(plan, config.models, sequence, routes=routes))
        for name, plan in plans.items()
    }


@pytest.mark.parametrize("name", REFERENCE_NAMES)
def test_the_planner_beats_what_does_nothing_or_looks_at_nothing(figures, name):
    """Oracle: what the goals ask for; with nothing charged, standing still would win the same table."""
    charges = {column.title for column in FRAME_COLUMNS if "charged" in column.meaning}
    assert len(charges) == 5
    assert all(figures["shipped"][title] < figures[name][title] for title in charges)
    assert figures["shipped"]["served %"] > figures[name]["served %"] + 20
    assert figures["stand still"]["served %"] == 0.0
    for title in ("uncharged feasibility", "uncharged stability", "uncharged collision"):
        assert figures["stand still"][title] <= figures["shipped"][title]


def test_a_straight_line_ends_at_its_goal_and_standing_still_nowhere():
    """Oracle: by hand; a goal beyond the reach is pulled in along its bearing."""
    goals = jnp.asarray([[3.0, 4.0], [30.0, -40.0]])
    line, still = (ReferencePlanner(name, PlannerConfig())(goals, STATE) for name in ("straight line", "stand still"))
    np.testing.assert_allclose(line.path[:, -1], [[3.0, 4.0], [3.6, -4.8]], atol=1e-5)
    np.testing.assert_allclose(jnp.cross(line.path, line.path[:, -1:]), 0.0, atol=1e-4)
    assert float(jnp.abs(still.path).max()) <= 1e-4
    # Standing on the left foot, the right one steps first: at -width/2, then the left one at +width/2.
    np.testing.assert_allclose(still.footsteps[0, :2], [[0.0, -0.05], [0.0, 0.05]], atol=2e-4)
    np.testing.assert_array_equal(still.first_swing, [0, 1])


def test_who_is_charged():
    """Oracle: by hand."""
    metrics = PlanMetrics(*(np.asarray([1.0, 2.0]) for _ in range(5)))
    charge = ShortfallCharge(1.0, 2.0, 3.0, 4.0, 5.0)
    got = charged(metrics, np.asarray([True, False]), charge)
    assert [list(value) for value in got.values()] == [[1.0, 2.0 + k] for k in range(1, 6)]
    assert all(list(value) == [1.0, 2.0] for value in charged(metrics, None, charge).values())


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="choose one of stand still, straight line"):
        ReferencePlanner("moonwalk", PlannerConfig())  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"ShortfallCharge\.collision is -1"):
        ShortfallCharge(collision=-1.0)
