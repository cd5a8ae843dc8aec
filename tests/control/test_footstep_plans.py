"""Footstep plans against NumPy re-derivations, and what a plan may not ask for."""

import numpy as np
import pytest

from iwalker_jax.control.footstep_check import check_footsteps, load_footsteps
from iwalker_jax.control.footstep_plan import footsteps_along, make_plan, velocity_footsteps
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import Side, side_of_step
from iwalker_jax.optimization import StepReach

REACH = StepReach(sagittal=0.3, lateral_min=0.045, lateral_max=0.26)


def test_straight_steps_alternate_about_the_line():
    positions, yaws = velocity_footsteps(0.2, 0.0, 0.0, 12, 0.24, 0.1, first_swing=1, ramp=1)
    expected_x = 0.048 * np.cumsum([0.5, *[1] * 8, 0.5, 0, 0])
    np.testing.assert_allclose(positions[:, 0], expected_x, atol=1e-12)
    np.testing.assert_allclose(positions[:, 1], 0.05 * np.array([1, -1] * 6), atol=1e-12)
    np.testing.assert_allclose(yaws, 0)
    plan = make_plan(positions, yaws, 1, rows=20)
    assert list(side_of_step(plan.first_swing, np.arange(4))) == [Side.LEFT, Side.RIGHT, Side.LEFT, Side.RIGHT]
    np.testing.assert_allclose(plan.positions[12:14], positions[-2:], atol=1e-6)


def test_turning_and_walking_follows_a_circle():
    rate, speed = np.radians(15), 0.1
    positions, yaws = velocity_footsteps(speed, 0.0, rate, 60, 0.24, 0.1, first_swing=0, ramp=0)
    centre = np.array([0.0, speed / rate])
    radius = np.linalg.norm(positions[:-2] - centre, axis=1)
    # Chords of the circle through the track's middle: inner feet 5 cm inside, outer feet 5 cm outside.
    np.testing.assert_allclose(radius[0::2], speed / rate + 0.05, atol=2e-3)
    np.testing.assert_allclose(radius[1::2], speed / rate - 0.05, atol=2e-3)
    np.testing.assert_allclose(np.diff(yaws[:-2]), rate * 0.24, atol=1e-12)


def test_footsteps_along_an_arc_lie_on_their_tracks():
    angle = np.linspace(0, 1.5, 200)
    path = np.stack([np.sin(angle), 1 - np.cos(angle)], axis=1)
    positions, yaws = footsteps_along(path, 0.05 * np.arange(1, 25), 0.1, first_swing=1)
    radius = np.linalg.norm(positions - [0, 1], axis=1)
    np.testing.assert_allclose(radius[0::2], 0.95, atol=1e-3)
    np.testing.assert_allclose(radius[1::2], 1.05, atol=1e-3)
    np.testing.assert_allclose(yaws, 0.05 * np.arange(1, 25), atol=5e-3)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda p, y: p.__setitem__((3, 0), 1.0), "footstep 4 .* ahead of the stance foot, out of reach"),
        (lambda p, y: p.__setitem__((2, 1), -0.06), "footstep 3 .* cross the legs"),
        (lambda p, y: p.__setitem__((2, 1), 0.4), "footstep 3 .* beside the stance foot, out of reach"),
        (lambda p, y: y.__setitem__(4, 1.4), "footstep 5 .* turns 80 degrees"),
    ],
)
def test_impossible_footsteps_are_named(change, sentence):
    positions, yaws = velocity_footsteps(0.1, 0.0, 0.0, 10, 0.24, 0.1, first_swing=1)
    check_footsteps(positions, yaws, 1, REACH)
    change(positions, yaws)
    with pytest.raises(InputError, match=sentence):
        check_footsteps(positions, yaws, 1, REACH)


def test_the_first_step_is_checked_against_the_stance_foot():
    positions, yaws = velocity_footsteps(0.1, 0.0, 0.0, 10, 0.24, 0.1, first_swing=1)
    with pytest.raises(InputError, match=r"footstep 1 \(left foot\)"):
        check_footsteps(positions, yaws, 1, REACH, stance=np.array([1.0, -0.05, 0.0]))


def test_files_round_trip(tmp_path):
    file = tmp_path / "steps.csv"
    file.write_text("# side, x, y, yaw\nleft, 0.05, 0.05, 0\nright, 0.10, -0.05, 5\n\nleft, 0.10, 0.05, 5\n")
    positions, yaws, first = load_footsteps(file)
    assert first == 1
    np.testing.assert_allclose(positions, [[0.05, 0.05], [0.1, -0.05], [0.1, 0.05]])
    np.testing.assert_allclose(np.degrees(yaws), [0, 5, 5])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("left, 0, 0\n", "line 1 reads"),
        ("left, 0, 0, 0\nleft, 0, 0, 0\n", "line 2: the left foot steps twice"),
        ("left, 0, nan, 0\n", "line 1 holds NaN"),
        ("left, 0, x, 0\n", "line 1: .* no number"),
        ("left, 0, 0, 0\n", "holds 1 footsteps"),
    ],
)
def test_bad_files_are_refused_with_the_line(tmp_path, text, sentence):
    file = tmp_path / "steps.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=sentence):
        load_footsteps(file)
    with pytest.raises(InputError, match="cannot be read"):
        load_footsteps(tmp_path / "missing.csv")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((np.zeros((3, 3)), np.zeros(3), 0), "positions \\(K, 2\\)"),
        ((np.full((3, 2), np.nan), np.zeros(3), 0), "NaN"),
        ((np.zeros((3, 2)), np.zeros(3), 2), "first_swing is 2"),
        ((np.zeros((1, 2)), np.zeros(1), 0), "at least two"),
    ],
)
def test_bad_plans_are_refused(arguments, sentence):
    with pytest.raises(InputError, match=sentence):
        make_plan(*arguments)
