"""The published set-up: its constants are the paper's, its lower levels can be solved, and it learns."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.optimization import solve_step_mpc
from iwalker_jax.planning.istepper import IStepper
from iwalker_jax.planning.planner import PATH_POINTS, Planner, PlannerConfig
from iwalker_jax.planning.robot_state import RobotState, pre_impact_planes, sample_robot_state
from iwalker_jax.training.config import TrainConfig, paper_preset, small_paper_preset
from iwalker_jax.training.losses import LossWeights
from iwalker_jax.training.train_step import initial_state, make_optimiser, make_train_step

PAPER = paper_preset()
STEPS = PAPER.planner.steps


def parameter_counts(config: PlannerConfig) -> dict[str, int]:
    state = nnx.state(nnx.eval_shape(lambda: Planner(config, nnx.Rngs(0))), nnx.Param)
    return {name: sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(part)) for name, part in state.items()}


def shrunken(**changes) -> TrainConfig:
    """The preset on images of 90 x 160 with a narrow trunk."""
    config = small_paper_preset()
    ipath = dataclasses.replace(config.planner.ipath, trunk_width=4)
    return dataclasses.replace(config, planner=dataclasses.replace(config.planner, ipath=ipath), **changes)


def states(count: int) -> RobotState:
    keys = jax.random.split(jax.random.key(1), count)
    return jax.vmap(lambda key: sample_robot_state(key, STEPS, PAPER.planner.hlip))(keys)


def walked_footsteps() -> jax.Array:
    """[m] 150 footsteps of a winding centimetre walk."""
    k = 1.0 + np.arange(STEPS.count)
    sides = np.where(np.arange(STEPS.count) % 2, -1.0, 1.0)
    return jnp.asarray(np.stack([STEPS.length * k, 0.05 * sides + 0.2 * np.sin(0.05 * k)], axis=1), jnp.float32)


def test_both_networks_have_the_published_size():
    """Oracle: the paper's layout, 53.3 M parameters for iPath; 2N -> 256 -> 512 -> 2N, N = 150, for iStepper."""
    counts = parameter_counts(PAPER.planner)
    assert counts["ipath"] == pytest.approx(53.3e6, rel=2e-3)
    assert counts["istepper"] == 301 * 256 + 257 * 512 + 513 * 300 == 362_540
    assert parameter_counts(small_paper_preset().planner)["istepper"] == 362_540


def test_the_constants_are_the_published_ones():
    """Oracle: the paper's and its prototype's numbers, written out."""
    unicycle, steps, ipath = PAPER.models.unicycle, PAPER.planner.step_weights, PAPER.planner.ipath
    assert (unicycle.position_weight, unicycle.turn_weight, unicycle.acceleration_weight) == (1, 1000, 5000)
    assert (unicycle.dt, unicycle.turn_bound, unicycle.acceleration_bound) == (1, 1e-3, 1e-2)
    assert PATH_POINTS == 100
    assert (steps.footstep, steps.effort) == (100, 3)
    assert (steps.orbit_position, steps.orbit_velocity, steps.terminal) == (0, 0, 0)
    assert PAPER.planner.hlip.step_time == 0.24
    assert (STEPS.count, STEPS.length) == (150, 0.01)
    assert (ipath.camera.height, ipath.camera.width, ipath.waypoints, ipath.trunk_width) == (360, 640, 5, 64)
    assert 2 * np.degrees(np.arctan2(ipath.camera.width / 2, ipath.camera.fx)) == pytest.approx(90)
    assert ipath.goal_is_end and not ipath.even and not ipath.equivariant
    assert (PAPER.method, PAPER.gradient, PAPER.mirror) == ("iwalker", "stopped", True)
    assert (PAPER.batch_size, PAPER.epochs, PAPER.source.frames) == (1, 30, 1185)


def test_the_losses_are_the_published_terms_alone():
    """U_path is the tracking term; U_step has tracking, width, length and collision, and reaches iPath."""
    present = {name for name, weight in vars(PAPER.weights).items() if weight > 0}
    assert present == {
        "tracking", "step_tracking", "step_width", "step_length", "published_collision", "step_to_path"
    }  # fmt: skip


def test_the_optimiser_is_plain_adam():
    """Oracle: optax's Adam at one rate, over gradients of every size."""
    ours, oracle = make_optimiser(PAPER, 30), optax.adam(PAPER.learning_rate)
    params = {"a": jnp.ones((3, 4)), "b": jnp.ones(5)}
    state, expected_state = ours.init(params), oracle.init(params)
    for number, size in enumerate((0.1, 1e4, 1.0, 30.0)):
        key = jax.random.key(number)
        gradient = jax.tree.map(lambda leaf, k=key, s=size: s * jax.random.normal(k, leaf.shape), params)
        updates, state = ours.update(gradient, state, params, norm=optax.global_norm(gradient))
        expected, expected_state = oracle.update(gradient, expected_state, params)
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6), updates, expected)


def test_the_stepper_sees_no_robot_state_but_the_side():
    stepper = IStepper(PAPER.planner.istepper, STEPS, nnx.Rngs(0))
    paths = jnp.cumsum(0.02 * jax.random.normal(jax.random.key(0), (3, PATH_POINTS, 2)) + 0.01, axis=1)
    given = states(3)
    before = stepper(paths, given)
    assert before.shape == (3, 150, 2)
    for name in ("com_from_stance", "com_velocity", "time_in_step"):
        changed = given._replace(**{name: getattr(given, name) + 0.3})
        np.testing.assert_array_equal(stepper(paths, changed), before)
    sides = jnp.asarray([1.0, -1.0])
    np.testing.assert_allclose(stepper(paths * sides, given.mirrored()), before * sides, atol=1e-6)
    assert float(jnp.max(jnp.abs(stepper(paths * 1.1, given) - before))) > 1e-3


def test_150_footsteps_are_tracked_in_single_precision():
    """Oracle: the footsteps' own linear system in NumPy. Weights that leave the COM out know no pendulum; BRUCE's runs
    away beyond single precision."""
    planner, footsteps = PAPER.planner, walked_footsteps()
    state = jax.tree.map(lambda leaf: leaf[0], states(1))
    planes = pre_impact_planes(state, planner.hlip)
    solution = solve_step_mpc(footsteps, planes, planner.tracking_pendulum, planner.step_weights, "stopped")
    weights, count = planner.step_weights, STEPS.count
    step = np.eye(count) - np.eye(count, k=-1)
    start = np.zeros((count, 2))
    start[0] = -np.asarray(state.com_from_stance)
    system = weights.footstep * np.eye(count) + weights.effort * step.T @ step
    wanted = np.linalg.solve(system, weights.footstep * np.asarray(footsteps) + weights.effort * step.T @ start)
    np.testing.assert_allclose(solution.value.footsteps, wanted, atol=1e-5)
    assert bool(solution.gradient_valid) and np.isfinite(solution.value.states).all()
    # The prototype's bound on a step, 2 m, is far.
    assert float(jnp.max(jnp.abs(solution.value.inputs))) < 0.2
    assert not solve_step_mpc(footsteps, planes, planner.hlip, planner.step_weights).gradient_valid
    assert PlannerConfig().tracking_pendulum is PlannerConfig().hlip


def test_two_steps_change_the_weights_and_leave_no_nan(small_data):
    config = shrunken()
    optimiser = make_optimiser(config, 2)
    state = initial_state(config, optimiser)
    before = jax.tree.map(np.array, state.params)
    step = make_train_step(config, optimiser)
    for index in (0, 5):
        state, report = step(state, small_data, jnp.asarray([index]))
        assert bool(report.finite) and float(report.converged) == 1.0
        assert all(np.isfinite(value).all() for value in report.losses.values())
        assert float(report.losses["total"]) > 0
    moved = jax.tree.map(lambda x, y: float(np.max(np.abs(x - np.asarray(y)))), before, state.params)
    assert np.isfinite(jax.tree.leaves(moved)).all()
    for network in ("ipath", "istepper"):
        # Two updates of Adam move no weight further than its rate each.
        assert 0.5e-4 < max(jax.tree.leaves(moved[network])) < 2.5e-4


def test_what_cannot_be_combined_is_refused():
    with pytest.raises(InputError, match="leave the COM free"):
        dataclasses.replace(PAPER, weights=LossWeights(placement=1.0))
    with pytest.raises(InputError, match="cannot end at the goal"):
        dataclasses.replace(PAPER.planner.ipath, even=True)
    with pytest.raises(InputError, match="warm_up"):
        TrainConfig(warm_up=-1)
    with pytest.raises(InputError, match="None for no clipping"):
        TrainConfig(clip=0.0)
