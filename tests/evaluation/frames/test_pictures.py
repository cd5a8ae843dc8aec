"""Picture sheets: written, of the asked number of columns, and showing what they should."""

import dataclasses

import cv2
import matplotlib.pyplot as plt
import numpy as np
import pytest

from iwalker_jax.evaluation.frames.pictures import save_sheet
from tests.evaluation.frame_results import make_result, make_sequence


@pytest.fixture(scope="module")
def sheet(tmp_path_factory) -> np.ndarray:
    """The picture of four frames in RGB."""
    file = tmp_path_factory.mktemp("sheets") / "deep" / "office.png"
    save_sheet(make_sequence(), make_result(), file)
    image = cv2.imread(str(file))
    assert image is not None
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def pixels_of(image: np.ndarray, colour: str) -> int:
    """Number of pixels near a matplotlib colour."""
    from matplotlib.colors import to_rgb

    wanted = np.array(to_rgb(colour)) * 255
    return int((np.abs(image.astype(float) - wanted).max(axis=-1) < 70).sum())


def test_the_sheet_is_large_and_not_blank(sheet):
    """Oracle: OpenCV reads it; every quarter of the sheet holds many colours."""
    assert sheet.shape[0] > 800 and sheet.shape[1] > 800
    for half in np.array_split(sheet, 2, axis=0):
        for quarter in np.array_split(half, 2, axis=1):
            assert len(np.unique(quarter.reshape(-1, 3), axis=0)) > 100


@pytest.mark.parametrize("colour", ["tab:red", "tab:cyan", "tab:blue", "tab:orange", "magenta", "black"])
def test_path_footsteps_goal_and_obstacles_are_drawn(sheet, colour):
    assert pixels_of(sheet, colour) > 40


def test_an_obstacle_to_the_left_is_drawn_to_the_left(tmp_path):
    """Property: moving the obstacle to the right moves its black pixels right; the sheet is otherwise the same."""
    centres = []
    for columns in (slice(100, 125), slice(35, 60)):
        result = make_result(frames=1)
        occupied = np.zeros_like(result.maps.occupied)
        occupied[:, 50:90, columns] = True
        result = dataclasses.replace(result, maps=result.maps._replace(occupied=occupied, esdf=1.0 - 2.0 * occupied))
        save_sheet(make_sequence(frames=1), result, tmp_path / "one.png")
        image = cv2.imread(str(tmp_path / "one.png"))
        dark = np.argwhere(image[image.shape[0] // 4 : image.shape[0] // 2].max(axis=-1) < 10)
        centres.append(dark[:, 1].mean() / image.shape[1])
    assert centres[0] < 0.5 < centres[1]


def test_the_number_of_columns_and_recordings_without_truth(tmp_path):
    """A sheet of two of six frames is narrower than one of six, and needs no ground truth; no figure stays open."""
    result, sequence = make_result(truth=False, frames=6), make_sequence(frames=6)
    widths = []
    for frames in (2, 6):
        save_sheet(sequence, result, tmp_path / "sheet.png", frames=frames)
        widths.append(cv2.imread(str(tmp_path / "sheet.png")).shape[1])
    assert widths[1] == pytest.approx(3 * widths[0], rel=0.02)
    assert plt.get_fignums() == []
