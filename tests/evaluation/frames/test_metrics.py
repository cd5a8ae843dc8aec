"""Metrics: the paper's three re-derived, and the truth about a scene made by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from iwalker_jax.evaluation.frames.metrics import (
    TrueMetrics,
    goal_in_view,
    goal_served,
    plan_metrics,
    to_world,
    true_metrics,
)
from iwalker_jax.optimization import HlipParameters, StepMpcWeights, solve_step_mpc
from iwalker_jax.perception.grid import PUBLISHED_GRID
from iwalker_jax.planning.footsteps import nominal_footsteps
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import PlannerConfig, waypoints_to_path
from iwalker_jax.planning.robot_state import RobotState, StepGeometry, pre_impact_planes
from iwalker_jax.scenes.routes import shortest_distance
from iwalker_jax.scenes.scene import Scene

MODELS = PlannerModels()
WAYPOINTS = np.array([[0.4, 0.0], [0.9, 0.15], [1.2, 0.5], [1.7, 0.6], [2.4, 0.5]], np.float32)
STATE = RobotState(*(jnp.asarray(x, jnp.float32) for x in ([0.01, -0.04], [0.2, 0.05], 1.0, 0.1)))
BODY = 0.15


@pytest.fixture(scope="module")
def planned():
    """A path, its footsteps and a smooth collision map, with their metrics."""
    path = waypoints_to_path(jnp.asarray(WAYPOINTS)[None])[0]
    footsteps, _ = nominal_footsteps(path, STATE.stance_sign, StepGeometry())
    x, y = (low + (np.arange(100) + 0.5) * 0.1 for low in (PUBLISHED_GRID.x_min, PUBLISHED_GRID.y_min))
    published = np.exp(-((x[:, None] - 1.5) ** 2 + (y - 0.2) ** 2)).astype(np.float32)
    score = jax.jit(lambda *arguments: plan_metrics(*arguments, PlannerConfig(), MODELS))
    return path, footsteps, published, *score(path, jnp.asarray(WAYPOINTS), footsteps, STATE, jnp.asarray(published))


def test_collision_is_the_published_map_summed_over_the_footsteps(planned):
    """Oracle: SciPy's bilinear interpolation."""
    _, footsteps, published, metrics, _ = planned
    axes = [low + (np.arange(100) + 0.5) * 0.1 for low in (PUBLISHED_GRID.x_min, PUBLISHED_GRID.y_min)]
    points = np.maximum(np.asarray(footsteps), [axes[0][0], axes[1][0]])
    assert float(metrics.collision) == pytest.approx(RegularGridInterpolator(axes, published)(points).sum(), rel=1e-4)


def test_collision_as_published_is_summed_centimetre_by_centimetre(planned):
    """Oracle: SciPy's bilinear interpolation at 150 points found by walking a fine polyline of the path."""
    path, _, published, metrics, _ = planned
    axes = [low + (np.arange(100) + 0.5) * 0.1 for low in (PUBLISHED_GRID.x_min, PUBLISHED_GRID.y_min)]
    points = np.asarray(path, float)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    centres = np.stack([np.interp(0.01 * np.arange(1, 151), along, points[:, k]) for k in range(2)], axis=1)
    centres = np.maximum(centres, [axes[0][0], axes[1][0]])
    wanted = RegularGridInterpolator(axes, published)(centres).sum()
    assert float(metrics.collision_published) == pytest.approx(wanted, rel=2e-3)


def test_stability_is_the_variance_of_relative_intervals(planned):
    """Oracle: the definition in plain Python."""
    gaps = [float(np.hypot(*(b - a))) for a, b in zip([np.zeros(2), *WAYPOINTS], WAYPOINTS)]
    mean = sum(gaps) / 5
    wanted = 1000.0 * sum((gap / mean - 1.0) ** 2 for gap in gaps) / 5
    assert float(planned[3].stability) == pytest.approx(wanted, rel=1e-4)


def test_feasibility_is_the_mean_square_over_three_coordinates(planned):
    """Oracle: the definition, on the tracked path that is handed back; that path obeys the unicycle by integration."""
    path, _, _, metrics, tracked = (np.asarray(x) if not hasattr(x, "_fields") else x for x in planned)
    flat = np.concatenate([path - tracked, np.zeros((100, 1))], axis=1)
    assert float(metrics.feasibility) == pytest.approx(1000.0 * np.mean(flat**2), rel=1e-4)
    assert 0.0 < float(metrics.feasibility) < 50.0
    steps = np.diff(tracked, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.abs(np.diff(heading)).max() < 0.2


def test_hlip_cost_is_the_step_mpcs_own(planned):
    """Oracle: the solver called directly."""
    _, footsteps, _, metrics, _ = planned
    planes = pre_impact_planes(STATE, HlipParameters())
    direct = solve_step_mpc(footsteps, planes, HlipParameters(), StepMpcWeights(), "stopped").value.cost
    assert float(metrics.hlip_cost) == pytest.approx(float(direct), rel=1e-3)


def test_an_even_straight_path_is_feasible_and_stable(planned):
    """Oracle: a straight line at constant speed is its own unicycle optimum."""
    waypoints = jnp.stack([jnp.linspace(0.5, 2.5, 5), jnp.zeros(5)], axis=1)
    score = jax.jit(lambda *arguments: plan_metrics(*arguments, PlannerConfig(), MODELS))
    path = waypoints_to_path(waypoints[None])[0]
    metrics, tracked = score(path, waypoints, planned[1], STATE, jnp.asarray(planned[2]))
    assert float(metrics.feasibility) < 1e-3
    assert float(metrics.stability) < 1e-4
    np.testing.assert_allclose(tracked, path, atol=5e-3)


# One wall across the way at world x = 3, open above y = 4; the robot stands at (1, 2) looking along +y.
POSE = np.array([1.0, 2.0, np.pi / 2], np.float32)
WALL = (3.0, 2.0, 0.1, 2.0)


@pytest.fixture(scope="module")
def scene():
    x, y, hx, hy = WALL
    return Scene("wall", "test", np.array([[x, y, 0.5, hx, hy, 0.5, 0.0]]), np.empty((0, 5)), (0, 0, 6, 6)).arrays()


@pytest.fixture(scope="module")
def judge(scene):
    """True metrics of a polyline in the base frame towards a base-frame goal."""

    @jax.jit
    def score(path, footsteps, goal):
        shortest = shortest_distance(scene, to_world(jnp.asarray(POSE), goal))
        return true_metrics(path, footsteps, goal, jnp.asarray(POSE), scene, shortest, BODY)

    def run(corners, goal, footsteps=None) -> TrueMetrics:
        corners = np.asarray(corners, float)
        at = np.linspace(0, 1, 100)
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
        path = np.stack([np.interp(at * along[-1], along, corners[:, k]) for k in range(2)], axis=1)
        steps = path[5::5] if footsteps is None else footsteps
        return jax.tree.map(float, score(*(jnp.asarray(x, jnp.float32) for x in (path, steps, goal))))

    return run


def test_base_points_in_the_world():
    """Oracle: complex numbers."""
    points = np.random.default_rng(0).normal(size=(7, 2))
    pose = np.array([0.3, -1.2, 2.1])
    turned = (points[:, 0] + 1j * points[:, 1]) * np.exp(1j * pose[2]) + complex(*pose[:2])
    np.testing.assert_allclose(
        to_world(jnp.asarray(pose), jnp.asarray(points)).T, [turned.real, turned.imag], atol=1e-5
    )


def test_a_path_through_the_wall_collides_where_the_body_meets_it(judge):
    """Oracle: by hand. In base, the wall's face is 1.9 m to the right; the body meets it 0.15 m before."""
    truth = judge([(0, 0), (0, -4)], (0.0, -4.0))
    assert truth.path_collides == 1.0
    assert truth.path_in_collision == pytest.approx((0.2 + 2 * BODY) / 4, abs=0.015)
    assert truth.footsteps_in_collision == pytest.approx(2 / 19, abs=0.06)
    assert truth.goal_distance == pytest.approx(0.0, abs=1e-5)
    # The path ends at the goal, so it gains the whole way around, and walked less than any true route.
    assert truth.progress == pytest.approx(truth.remaining, abs=0.2)
    assert truth.efficiency > 1.2


def test_a_path_around_the_wall_is_efficient_and_free(judge):
    """Oracle: the taut string around the wall's end grown by 0.2 m."""
    corners = [(0, 0), (2.25, -1.85), (2.25, -2.15), (0, -4)]
    truth = judge(corners, (0.0, -4.0))
    assert truth.path_collides == 0.0
    assert truth.path_in_collision == truth.footsteps_in_collision == 0.0
    taut = 2 * np.hypot(2.2, 1.9) + 0.2
    assert truth.remaining == pytest.approx(taut, rel=0.05)
    assert truth.efficiency == pytest.approx(1.0, abs=0.05)


def test_progress_is_measured_along_the_route_not_through_the_wall(judge):
    """Oracle: by hand. Towards the wall's end is progress; straight towards the goal behind the wall is not."""
    ahead = judge([(0, 0), (1.1, -0.95)], (0.0, -4.0))
    assert ahead.progress == pytest.approx(np.hypot(1.1, 0.95), abs=0.15)
    back = judge([(0, 0), (-1.0, 0)], (0.0, -4.0))
    assert back.progress < -0.5
    assert back.efficiency < 0.85
    towards = judge([(0, 0), (0, -1.6)], (0.0, -4.0))
    assert towards.path_collides == 0.0
    assert towards.goal_distance < ahead.goal_distance
    assert towards.progress < 0.6 * ahead.progress


def test_ending_inside_the_wall_is_no_progress(judge):
    truth = judge([(0, 0), (0, -2.0)], (0.0, -4.0))
    assert truth.progress == -np.inf
    assert truth.efficiency == 0.0


def test_only_footsteps_that_touch_count(judge):
    """Oracle: two of four feet within the body's radius of the wall."""
    steps = np.array([[0.0, -1.0], [0.0, -1.78], [0.0, -2.0], [0.0, -2.5]])
    assert judge([(0, 0), (0, -1)], (0.0, -4.0), steps).footsteps_in_collision == 0.5


def test_standing_still_is_finite(judge):
    truth = judge([(0, 0), (0, 0)], (1.0, 0.0))
    assert all(np.isfinite(value) for value in truth)
    assert truth.progress == pytest.approx(0.0, abs=1e-4)
    assert truth.goal_distance == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    ("goal", "seen"),
    [((2.0, 0.0), True), ((1.0, -1.5), False), ((0.0, -4.0), False), ((-1.0, 0.0), False), ((3.5, 0.0), False)],
)
def test_goals_in_view(scene, goal, seen):
    """Oracle: by hand, with half a view of 45 degrees and 3 m of range."""
    assert bool(goal_in_view(jnp.asarray(goal), jnp.asarray(POSE), scene, np.pi / 4, 3.0)) == seen


def test_a_wall_in_between_hides_a_goal(scene):
    """Oracle: by hand; turned towards the wall, the goal behind it is hidden, the one before it is not."""
    pose = jnp.asarray([1.0, 2.0, 0.0])
    assert not bool(goal_in_view(jnp.asarray([3.0, 0.0]), pose, scene, np.pi / 4, 6.0))
    assert bool(goal_in_view(jnp.asarray([1.5, 0.0]), pose, scene, np.pi / 4, 6.0))


def test_what_serves_a_goal():
    """Oracle: the rule's cases; a goal in view must be reached, another one approached, and nothing touched."""
    cases = [
        (0.1, 0.0, False, True, True),
        (0.1, 0.0, True, True, False),
        (0.5, 2.0, False, True, False),
        (5.0, 0.2, False, False, True),
        (5.0, 0.2, True, False, False),
        (5.0, 0.05, False, False, False),
    ]
    distance, progress, hit, view, wanted = zip(*cases)
    zeros = jnp.zeros(len(cases))
    truth = TrueMetrics(jnp.asarray(hit), zeros, zeros, jnp.asarray(distance), jnp.asarray(progress), zeros, zeros)
    np.testing.assert_array_equal(goal_served(truth, jnp.asarray(view)), wanted)
