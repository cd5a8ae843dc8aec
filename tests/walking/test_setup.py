"""Motions, files and conditions: geometry re-derived with NumPy, ranges, and one sentence for what is wrong."""

import numpy as np
import pytest

from iwalker_jax.control import GaitParameters
from iwalker_jax.errors import InputError
from iwalker_jax.walking.commands import Motion, load_path, make_walk, s_curve, standing_feet
from iwalker_jax.walking.setup import Disturbances, default_walker, sample_conditions

GAIT = GaitParameters()


@pytest.fixture(scope="module")
def setup():
    return default_walker()


def centres(walk) -> np.ndarray:
    """Middles between the tracks: of each planned footstep and the mean of its neighbours."""
    steps = np.asarray(walk.plan.positions, np.float64)[: int(walk.plan.count)]
    return (steps[:-2] + 2 * steps[1:-1] + steps[2:]) / 4


def test_the_s_curve_is_two_arcs_of_one_metre():
    curve = s_curve(3.0)
    # From (0, 0) along x: 1.5 rad about (0, 1), then 1.5 rad about the centre on the other side.
    first = np.array([np.sin(1.5), 1 - np.cos(1.5)])
    second = first + np.array([np.sin(1.5), 1 - np.cos(1.5)])
    np.testing.assert_allclose(curve[150], first, atol=1e-4)
    np.testing.assert_allclose(curve[-1], second, atol=1e-4)
    assert np.linalg.norm(np.diff(curve, axis=0), axis=1).sum() == pytest.approx(3.0)


@pytest.mark.parametrize("length", [0.03, 0.04, 0.05, 0.06])
def test_an_s_curve_walk_begins_between_the_feet_and_ends_on_the_curve(setup, length):
    _, model = setup
    walk = make_walk(Motion("s_curve", step_length=length), model, GAIT)
    start = standing_feet(model)[:, :2].mean(axis=0)
    np.testing.assert_allclose(centres(walk)[-1], s_curve(3.0)[-1] + start, atol=1e-3)
    assert np.linalg.norm(centres(walk)[0] - start) < length
    paces = np.linalg.norm(np.diff(centres(walk), axis=0), axis=1)
    assert np.median(paces) == pytest.approx(length, rel=0.01)
    assert np.max(paces) < 1.04 * length
    assert np.max(np.abs(np.diff(paces))) < 0.35 * length  # speeds up and slows down gently
    assert walk.speed == pytest.approx(length / 0.24)


def test_velocity_walks_go_where_they_should(setup):
    _, model = setup
    start = standing_feet(model)[:, :2].mean(axis=0)
    straight = make_walk(Motion("straight", 0.2, distance=3.0), model, GAIT)
    assert 3.0 <= centres(straight)[-1, 0] - start[0] < 3.05
    aside = make_walk(Motion("sideways", -0.05, distance=0.5), model, GAIT)
    assert -0.52 < centres(aside)[-1, 1] <= -0.5 + 1e-6
    on_the_spot = make_walk(Motion("in_place", seconds=12.0), model, GAIT)
    assert int(on_the_spot.plan.count) == 50
    np.testing.assert_allclose(centres(on_the_spot), np.tile(start, (48, 1)), atol=1e-6)
    turn = make_walk(Motion("turn", turn=30.0, seconds=12.0), model, GAIT, rows=100)
    assert turn.plan.yaws.shape == (100,)
    # 50 steps: two on the spot at the end, and half of the ramps' eight missing, give 44 whole ones of 7.2 degrees.
    assert np.degrees(turn.plan.yaws[49]) == pytest.approx(44 * 7.2, abs=0.1)
    stand = make_walk(Motion("stand", seconds=3.0), model, GAIT)
    assert int(stand.plan.count) == 0 and stand.seconds == 3.0


def test_files_of_paths_and_footsteps(setup, tmp_path):
    _, model = setup
    path = tmp_path / "path.csv"
    path.write_text("# x, y\n0, 0\n0.5, 0\n0.5, 0\n1.0, 0.1\n")
    np.testing.assert_array_equal(load_path(path), [[0, 0], [0.5, 0], [1.0, 0.1]])
    walk = make_walk(Motion("path", 0.1, file=path), model, GAIT)
    start = standing_feet(model)[:, :2].mean(axis=0)
    np.testing.assert_allclose(centres(walk)[-1] - start, [1.0, 0.1], atol=1e-3)
    steps = tmp_path / "steps.csv"
    steps.write_text("left, 0.03, 0.05, 0\nright, 0.06, -0.05, 0\nleft, 0.09, 0.05, 5\nright, 0.09, -0.05, 5\n")
    walk = make_walk(Motion("footsteps", file=steps), model, GAIT)
    np.testing.assert_allclose(np.asarray(walk.plan.positions)[1] - start, [0.06, -0.05], atol=1e-6)
    assert int(walk.plan.count) == 4


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Motion("dance"), "choose one of"),
        (lambda: Motion(speed=float("nan")), "m/s"),
        (lambda: Motion("path"), "give a file"),
        (lambda: Motion("straight", file="x.csv"), "reads no file"),
        (lambda: Disturbances(friction=(1.0, 0.5)), "smaller first"),
        (lambda: Disturbances(delay=(0, 99)), "ticks"),
        (lambda: Disturbances(mass=float("nan")), "mass"),
        (lambda: Disturbances(push_axis="z"), "x or y"),
        (lambda: default_walker("perfect"), "sensors"),
    ],
)
def test_bad_options_are_one_sentence(make, words, unchecked_types):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("text", "words"),
    [("0, 0\n1, x\n", "line 2"), ("0, 0\n1, nan\n", "line 2"), ("0, 0\n0, 0\n", "at least two"), ("1\n", "line 1")],
)
def test_bad_paths_are_one_sentence(tmp_path, text, words):
    file = tmp_path / "path.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=words):
        load_path(file)


def test_walks_out_of_reach_are_refused(setup, tmp_path):
    _, model = setup
    with pytest.raises(InputError, match="cannot be read"):
        make_walk(Motion("path", file=tmp_path / "none.csv"), model, GAIT)
    far = tmp_path / "steps.csv"
    far.write_text("left, 0.6, 0.05, 0\nright, 0.6, -0.05, 0\n")
    with pytest.raises(InputError, match="out of reach"):
        make_walk(Motion("footsteps", file=far), model, GAIT)
    with pytest.raises(InputError, match="above 0"):
        make_walk(Motion("s_curve", -0.1), model, GAIT)


def test_conditions_lie_in_their_ranges_and_depend_on_the_seed_alone(setup):
    walker, _ = setup
    wanted = Disturbances((0.4, 0.9), 0.1, push_impulse=2.0, push_axis="y", delay=(1, 2))
    many = sample_conditions(walker.robot, wanted, 64, 3)
    friction, mass, force = (np.asarray(x) for x in (many.friction, many.mass_scale, many.push_force))
    assert 0.4 <= friction.min() < 0.5 and 0.8 < friction.max() <= 0.9
    assert 0.9 <= mass.min() < 0.93 and 1.07 < mass.max() <= 1.1
    np.testing.assert_allclose(np.abs(force[:, 1]) * 0.1, 2.0, rtol=1e-6)
    assert set(np.sign(force[:, 1])) == {-1, 1} and not force[:, [0, 2]].any()
    assert set(np.asarray(many.delay)) == {1, 2}
    since = np.asarray(many.push_start) - wanted.push_after
    assert since.min() >= 0 and 0.4 < since.max() <= 0.48
    np.testing.assert_allclose(np.linalg.norm(many.qpos[:, 3:7], axis=1), 1.0, atol=1e-6)
    few = sample_conditions(walker.robot, wanted, 5, 3)
    np.testing.assert_array_equal(few.qpos, many.qpos[:5])
    assert not np.array_equal(sample_conditions(walker.robot, wanted, 5, 4).qpos, few.qpos)
