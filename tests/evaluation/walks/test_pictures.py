"""Sheets of walks: written, showing what they should where it is, and the numbers behind them re-derived."""

import dataclasses

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.walks.pictures import save_walk_sheet
from iwalker_jax.evaluation.walks.traces import save_trace_grid
from iwalker_jax.geometry import Side
from iwalker_jax.walking import TimedFootsteps, WalkRecord


def make_walk(turn: float = 0.0, fall: float | None = None, seconds: float = 4.0) -> WalkRecord:
    """A robot that glides at 0.15 m/s along an arc (turn in rad/s, left positive) and steps every 0.25 s."""
    time = np.arange(0.0, seconds, 0.01)
    n = len(time)
    yaw = turn * time
    forward = 0.15 * np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1)
    com = np.cumsum(forward, axis=0) * 0.01 + np.array([0.0, 0.0, 0.365])
    touchdown = np.arange(0.5, seconds, 0.25)
    count = len(touchdown)
    left = np.arange(count) % 2 == 0
    yaws = turn * touchdown
    centres = np.stack([np.interp(touchdown, time, com[:, i]) for i in range(2)], axis=1)
    positions = centres + np.where(left, 0.05, -0.05)[:, None] * np.stack([-np.sin(yaws), np.cos(yaws)], axis=1)
    actual = np.concatenate([positions + np.array([0.006, 0.008]), yaws[:, None]], axis=1)
    right_stands = (time % 0.5) < 0.25
    forces = np.zeros((n, 4, 3))
    forces[right_stands, :2] = (2.0, 1.5, 22.0)
    forces[~right_stands, 2:] = (0.0, 4.0, 20.0)
    feet = np.repeat(com[:, None, :] * np.array([1.0, 1.0, 0.0]), 2, axis=1)
    torques = np.sin(20 * time)[:, None] * np.linspace(1.0, 8.0, 16)
    if fall is not None:
        for values in (com, forward, feet, torques, forces):
            values[time > fall] = np.nan
        actual[touchdown > fall] = np.nan
    return WalkRecord(
        time=time,
        com=com,
        com_velocity=forward,
        base_rpy=np.stack([0 * yaw, 0 * yaw, yaw], axis=1),
        foot_positions=feet,
        torques=torques,
        torque_limits=np.full(16, 10.5),
        forces=forces,
        planned=TimedFootsteps(touchdown, positions, yaws, np.where(left, Side.LEFT, Side.RIGHT)),
        actual=actual,
        commanded_speed=np.full(n, 0.15),
        estimated_velocity=forward,
        path=com[np.isfinite(com).all(axis=1)][::20, :2],
        push_times=(1.0,),
        friction=0.8,
    )


def pixels_of(image: np.ndarray, colour: str) -> np.ndarray:
    """(n, 2) row and column of the pixels near a matplotlib colour."""
    from matplotlib.colors import to_rgb

    return np.argwhere(np.abs(image.astype(float) - np.array(to_rgb(colour)) * 255).max(axis=-1) < 30)


def read(file) -> np.ndarray:
    image = cv2.imread(str(file))
    assert image is not None
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory) -> np.ndarray:
    """The sheet of a walk in RGB."""
    file = tmp_path_factory.mktemp("sheets") / "deep" / "walk.png"
    save_walk_sheet(make_walk(0.2), file, "arc to the left")
    return read(file)


def test_the_sheet_is_large_and_has_something_everywhere(sheet):
    """Oracle: OpenCV reads it; each of twelve parts holds many colours, and no figure stays open."""
    assert sheet.shape[0] > 800 and sheet.shape[1] == 1200
    for row in np.array_split(sheet, 4, axis=0):
        for part in np.array_split(row, 3, axis=1):
            assert len(np.unique(part.reshape(-1, 3), axis=0)) > 60
    assert plt.get_fignums() == []


@pytest.mark.parametrize("colour", ["tab:orange", "tab:blue", "tab:red", "tab:green", "tab:purple", "black", "0.65"])
def test_feet_path_and_curves_are_drawn(sheet, colour):
    assert len(pixels_of(sheet, colour)) > 40


def test_left_feet_are_drawn_to_the_left_of_the_path(tmp_path):
    """Walking along +x, which points right in the picture, blue left feet lie above orange right ones."""
    save_trace_grid([make_walk()], tmp_path / "one.png")
    image = read(tmp_path / "one.png")[:-60]  # without the legend
    assert pixels_of(image, "tab:blue")[:, 0].max() < pixels_of(image, "tab:orange")[:, 0].min()


def test_a_walk_that_bends_left_ends_higher_in_the_picture(tmp_path):
    """All panels have one scale: of two mirrored arcs, the right turn lies as far below as the other above."""
    save_trace_grid([make_walk(0.3), make_walk(-0.3)], tmp_path / "two.png", ["left", "right"])
    image = read(tmp_path / "two.png")[:-60]
    left, right = np.array_split(image, 2, axis=1)
    assert pixels_of(left, "tab:blue")[:, 0].min() < pixels_of(right, "tab:orange")[:, 0].min() - 30
    assert pixels_of(right, "tab:orange")[:, 0].max() > pixels_of(left, "tab:blue")[:, 0].max() + 30


def test_a_fall_missing_extras_and_standing_are_drawn(tmp_path, recwarn):
    """NaN after a fall, or nothing optional and a robot that stands without a plan: a sheet each, and no warning."""
    fallen = make_walk(fall=2.0)
    none = np.zeros(0)
    standing = dataclasses.replace(
        make_walk(),
        planned=TimedFootsteps(none, np.zeros((0, 2)), none, np.zeros(0, int)),
        actual=np.zeros((0, 3)),
        commanded_speed=None,
        estimated_velocity=None,
        path=None,
        push_times=(),
        friction=None,
    )
    for record in (fallen, standing):
        save_walk_sheet(record, tmp_path / "sheet.png")
        assert len(np.unique(read(tmp_path / "sheet.png"))) > 50
    save_trace_grid([fallen, standing, make_walk()], tmp_path / "grid.png", columns=2)
    assert [str(w.message) for w in recwarn] == []


def test_footstep_errors_and_friction_ratios_and_speeds():
    """Oracle: the numbers that made the walk; 6 and 8 mm make 1 cm, and 2.5 N over 22 N and 4 N over 20 N."""
    walk = make_walk(0.2, fall=2.0)
    made = walk.planned.times <= 2.0
    np.testing.assert_allclose(walk.footstep_errors()[made], 0.01)
    assert np.isnan(walk.footstep_errors()[~made]).all()
    ratios = walk.friction_ratios()
    stands = ((walk.time % 0.5) < 0.25) & (walk.time <= 2.0)
    np.testing.assert_allclose(ratios[stands, 0], 2.5 / 22.0)
    assert np.isnan(ratios[stands, 1]).all() and np.isnan(ratios[walk.time > 2.0]).all()
    speeds = walk.speeds_along_heading(walk.com_velocity)[walk.time <= 2.0]
    np.testing.assert_allclose(speeds, np.tile([0.15, 0.0], (len(speeds), 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("com", np.zeros((3, 3)), r"com has shape \(3, 3\).*must be \(400, 3\)"),
        ("torques", np.zeros((400, 15)), r"torques has shape \(400, 15\)"),
        ("actual", np.zeros((2, 3)), r"actual .* must be \(14, 3\)"),
        ("estimated_velocity", np.zeros(400), "estimated_velocity"),
        ("time", np.zeros(400), "does not increase"),
    ],
)
def test_records_that_do_not_fit_together(name, value, words, unchecked_types):
    with pytest.raises(InputError, match=words):
        dataclasses.replace(make_walk(), **{name: value})


def test_bad_files_and_titles(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be written"):
        save_walk_sheet(make_walk(), tmp_path / "file" / "sheet.png")
    with pytest.raises(InputError, match="1 walks and 2 titles"):
        save_trace_grid([make_walk()], tmp_path / "grid.png", ["a", "b"])
    with pytest.raises(InputError, match="0 walks"):
        save_trace_grid([], tmp_path / "grid.png")
    assert plt.get_fignums() == []
