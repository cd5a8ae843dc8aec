"""Films of episodes: what is drawn lies where projections by hand put it; films skip where nothing can be drawn."""

import dataclasses
import itertools

import cv2
import numpy as np
import pytest

from iwalker_jax.film.headless import configure_rendering
from iwalker_jax.perception import Intrinsics

configure_rendering()

from iwalker_jax.errors import InputError  # noqa: E402
from iwalker_jax.evaluation.episodes.film import FilmSettings, film_frames, film_model, planned_sides, write_film  # noqa: E402
from iwalker_jax.evaluation.episodes.film_panels import CELL_COLOURS, PanelPlan, depth_panel, legend_strip, map_panel  # noqa: E402
from iwalker_jax.evaluation.episodes.metrics import row_of  # noqa: E402
from iwalker_jax.evaluation.episodes.pictures import in_true_world  # noqa: E402
from iwalker_jax.geometry import Side, other_side  # noqa: E402
from iwalker_jax.navigation.record import Outcome  # noqa: E402
from iwalker_jax.perception.camera import CameraMount, camera_pose  # noqa: E402
from iwalker_jax.planning import MapCell  # noqa: E402
from tests.evaluation.episode_records import make_record, make_task, room  # noqa: E402

SMALL = FilmSettings(height=120, pace=5, samples=0)
SIZE = (480, 270)
HELD = 23  # frames of 1/15 s that last a second and a half
AHEAD = PanelPlan(
    np.stack([np.linspace(0, 2, 21), np.zeros(21)], axis=1),
    np.array([[0.1, 0.05], [0.2, -0.05], [0.3, 0.05], [0.4, -0.05]]),
    np.array([2.0, 1.0]),
    np.array([Side.LEFT, Side.RIGHT, Side.LEFT, Side.RIGHT]),
)


def coloured(image: np.ndarray, rgb: tuple[int, int, int], tolerance: int = 40) -> np.ndarray:
    """(n, 2) x and y of the pixels of a colour."""
    return np.argwhere(np.abs(image.astype(int) - rgb).max(axis=2) < tolerance)[:, ::-1]


@pytest.fixture(scope="module")
def filmed():
    record = make_record(outcomes=(Outcome.REACHED,), seconds=3.0, images=True)
    return make_task(), row_of(record, 0)


@pytest.fixture(scope="module")
def drawing(filmed) -> None:
    """Tests that draw are skipped on machines that cannot."""
    try:
        next(film_frames(*filmed, SMALL))
    except InputError as error:
        pytest.skip(str(error))


def test_the_goal_in_the_depth_image_lies_where_a_pinhole_puts_it():
    """Oracle: the pinhole equation of a level camera, worked out by hand."""
    R, p = camera_pose(CameraMount(height=0.5, pitch=0.0, forward=0.0).as_array())
    image = depth_panel(np.full((90, 160), 3.0), AHEAD, np.asarray(R), np.asarray(p), SIZE, Intrinsics())
    assert image.shape == (270, 480, 3)
    star = coloured(image, (214, 0, 190)).mean(axis=0)
    expected = 3 * (np.array([79.5 - 80 * 1.0 / 2.0, 44.5 + 80 * 0.5 / 2.0]) + 0.5)
    np.testing.assert_allclose(star, expected, atol=2.0)
    assert len(coloured(image, (217, 38, 38))) > 50


def test_nothing_measured_is_dark_and_near_is_brighter_than_far():
    R, p = (np.asarray(part) for part in camera_pose(CameraMount().as_array()))
    nowhere = PanelPlan(np.zeros((2, 2)), np.zeros((0, 2)), np.array([-5.0, 0.0]), np.zeros(0, int))
    images = [depth_panel(np.full((90, 160), metres), nowhere, R, p, SIZE, Intrinsics()) for metres in (0.0, 1.0, 5.0)]
    dark, near, far = (image[100:200, :100].mean() for image in images)
    assert dark < far < near


def test_the_map_turns_with_the_robot():
    """Oracle: a block 2 m north of a robot that looks north lies straight ahead, and to its left if it looks east."""
    cells = np.full((160, 160), MapCell.FREE, np.int8)
    cells[78:82, 118:122] = MapCell.OCCUPIED
    here = np.array([10.0, 20.0])
    for yaw, (ahead, left) in ((np.pi / 2, (2.0, 0.0)), (0.0, (0.0, 2.0))):
        image = map_panel(cells, here, np.array([*here, yaw]), AHEAD, SIZE)
        block = coloured(image, CELL_COLOURS[MapCell.OCCUPIED], 6).mean(axis=0)
        np.testing.assert_allclose(block, (240 - 60 * left, 270 - 60 * (ahead + 0.5)), atol=3.0)
    star = coloured(image, (214, 0, 190), 20).mean(axis=0)
    np.testing.assert_allclose(star, (240 - 60 * 1.0, 270 - 60 * 2.5), atol=3.0)


def test_a_goal_behind_is_an_arrow_at_the_edge():
    image = map_panel(
        np.zeros((160, 160), np.int8), np.zeros(2), np.zeros(3), AHEAD._replace(goal=np.array([0, -9])), SIZE
    )
    assert coloured(image, (214, 0, 190), 20)[:, 0].min() > 440


def test_left_feet_are_blue_and_right_ones_orange():
    """Oracle: the sides that the plan names, whatever the footsteps' places."""
    nothing = np.zeros((160, 160), np.int8)
    for sides in (AHEAD.sides, other_side(AHEAD.sides)):
        image = map_panel(nothing, np.zeros(2), np.zeros(3), AHEAD._replace(sides=sides), SIZE)
        for side, colour in ((Side.LEFT, (31, 119, 180)), (Side.RIGHT, (240, 120, 20))):
            marks = coloured(image, colour, 20).mean(axis=0)
            left = AHEAD.footsteps[sides == side, 1].mean()
            assert marks[0] == pytest.approx(240 - 60 * left, abs=1.0)


def test_a_films_footsteps_start_with_the_recorded_foot(filmed):
    _, episode = filmed
    right_first, left_first = (
        planned_sides(episode._replace(first_side=np.full_like(episode.first_side, side)), 3) for side in Side
    )
    np.testing.assert_array_equal(right_first[:3], [Side.RIGHT, Side.LEFT, Side.RIGHT])
    np.testing.assert_array_equal(left_first, other_side(right_first))
    assert len(left_first) == episode.footsteps.shape[1]


def test_plans_of_a_robot_that_is_lost_are_drawn_where_it_is():
    """Oracle: a straight path ahead of a robot that believes to stand at the origin lies ahead of where it stands."""
    record = row_of(make_record(), 0)
    lost = record._replace(believed=np.zeros_like(record.believed))
    drawn = in_true_world(np.array([[0.0, 0.0], [1.0, 0.0]]), lost, 7)
    x, y, yaw = record.base[6]
    np.testing.assert_allclose(drawn, [[x, y], [x + np.cos(yaw), y + np.sin(yaw)]], atol=1e-9)


def test_walls_are_cut_off_and_what_hangs_above_is_left_out():
    model = film_model(room(), cut=0.8)
    names = [model.geom(i).name for i in range(model.ngeom)]
    boxes = [model.geom(name) for name in names if name.startswith("box")]
    assert len(boxes) == 6  # without the beam
    tops = [float(box.pos[2] + box.size[2]) for box in boxes]
    np.testing.assert_allclose(sorted(tops), [0.4, 0.8, 0.8, 0.8, 0.8, 0.8])
    assert "ceiling" not in names


def test_frames_have_their_size_and_move(drawing, filmed):
    frames = list(film_frames(*filmed, SMALL))
    # Every fifth frame, and the last one for a second and a half at 15 frames a second.
    assert len(frames) == -(-(len(filmed[1].time) - 1) // 5) + HELD
    width, height = SMALL.size
    assert {frame.shape for frame in frames} == {(height, width, 3)}
    assert all(frame.std() > 10 for frame in frames)
    assert (np.abs(frames[3].astype(int) - frames[0])[36:, :160] > 10).mean() > 0.02


@pytest.mark.parametrize("suffix", ["webm", "gif"])
def test_a_film_is_written(drawing, filmed, tmp_path, suffix):
    file = tmp_path / "new" / f"film.{suffix}"
    count = write_film(file, *filmed, SMALL)
    capture = cv2.VideoCapture(str(file))
    frames = []
    while (answer := capture.read())[0]:
        frames.append(answer[1])
    # A GIF holds a picture that does not change once, for as long as it is seen.
    held = HELD - 1 if suffix == "gif" else 0
    assert len(frames) == count - held and frames[0].shape[1::-1] == SMALL.size


def test_a_robot_that_broke_is_filmed_up_to_there(drawing, filmed):
    task, episode = filmed
    broken = np.array(episode.qpos)
    broken[11:] = np.nan
    assert len(list(film_frames(task, episode._replace(qpos=broken), SMALL))) == 3 + HELD - 1


def test_an_episode_without_images_is_one_sentence():
    with pytest.raises(InputError, match="without images"):
        next(film_frames(make_task(), row_of(make_record(), 0)))


def test_unseen_free_and_occupied_ground_differ_on_the_map():
    """Oracle: a map of three bands across the robot's way, and the colours that the legend names."""
    cells = np.full((160, 160), MapCell.UNSEEN, np.int8)
    cells[100:120], cells[120:130] = MapCell.FREE, MapCell.OCCUPIED
    nowhere = PanelPlan(np.zeros((2, 2)), np.zeros((0, 2)), np.array([-5.0, 0.0]), np.zeros(0, int))
    image = map_panel(cells, np.zeros(2), np.zeros(3), nowhere, SIZE)
    column = image[:, 30]
    found = [column[round(270 - 60 * (ahead + 0.5))] for ahead in (0.4, 1.6, 2.25)]
    expected = [CELL_COLOURS[kind] for kind in (MapCell.UNSEEN, MapCell.FREE, MapCell.OCCUPIED)]
    np.testing.assert_array_equal(found, expected)
    distances = [np.abs(np.subtract(a, b)).max() for a, b in itertools.combinations(expected, 2)]
    assert min(distances) > 50
    legend = legend_strip(1200, 36)
    assert all(len(coloured(legend, colour, 2)) > 50 for colour in expected)


@pytest.mark.parametrize("outcome", [Outcome.REACHED, Outcome.COLLIDED, Outcome.MISTAKEN])
def test_the_last_frame_of_the_file_shows_how_it_ended(drawing, tmp_path, outcome):
    """Oracle: the outcome's colour and the last place; an end that a pace of seven frames would step over."""
    episode = row_of(make_record(outcomes=(outcome,), seconds=3.0, images=True), 0)
    settings = dataclasses.replace(SMALL, pace=7)
    file = tmp_path / "film.mp4"
    count = write_film(file, make_task(), episode, settings)
    assert (len(episode.time) - 1) % 7 and count == -(-(len(episode.time) - 1) // 7) + HELD
    capture = cv2.VideoCapture(str(file))
    frames = []
    while (answer := capture.read())[0]:
        frames.append(cv2.cvtColor(answer[1], cv2.COLOR_BGR2RGB))
    assert len(frames) == count
    for k, ends in ((-1, True), (-HELD, True), (-HELD - 1, False)):
        found = np.median(frames[k][:36].reshape(-1, 3), axis=0)
        assert (np.abs(found - outcome.rgb).max() < 25) == ends
    shown = list(film_frames(make_task(), episode, dataclasses.replace(settings, pace=1)))
    np.testing.assert_array_equal(shown[-1], list(film_frames(make_task(), episode, settings))[-1])


@pytest.mark.parametrize("options", [{"height": 121}, {"pace": 0}, {"cut": 0.0}])
def test_bad_settings(options):
    with pytest.raises(InputError):
        FilmSettings(**options)
