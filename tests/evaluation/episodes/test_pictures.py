"""Traces of episodes from above: footprints where feet stood, boxes where they are, pictures that can be read again."""

import cv2
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.episodes.metrics import row_of
from iwalker_jax.evaluation.episodes.pictures import box_corners, footprints, save_episode, save_episode_grid
from iwalker_jax.navigation.record import Outcome
from iwalker_jax.scenes.scene import obstacle_distance
from tests.evaluation.episode_records import make_record, make_task, room


def test_corners_lie_on_the_scenes_own_boundary():
    """Oracle: the scene's exact distance in plan."""
    scene = room()
    corners = box_corners(scene.boxes[5])
    np.testing.assert_allclose(obstacle_distance(scene.arrays(), jnp.asarray(corners, jnp.float32)), 0.0, atol=1e-5)
    assert np.linalg.norm(corners[0] - corners[1]) == pytest.approx(1.0)


def test_footprints_are_the_places_where_a_foot_stands():
    held = np.repeat(np.array([[0.0, 0.1, 0.0], [0.2, 0.1, 0.0], [0.4, 0.1, 0.0]]), 5, axis=0)
    swing = held[5:6] + np.array([-0.1, 0.0, 0.03])
    foot = np.concatenate([held[:5], swing, held[5:]])
    np.testing.assert_array_equal(footprints(foot), [[0.0, 0.1], [0.2, 0.1], [0.4, 0.1]])


def test_one_episode_and_a_grid_are_drawn(tmp_path):
    record = make_record(outcomes=(Outcome.REACHED, Outcome.COLLIDED, Outcome.GAVE_UP))
    tasks = [make_task("a"), make_task("b"), make_task("c", goals=((3.0, 2.7), (5.0, 1.0)))]
    episodes = [row_of(record, i) for i in range(3)]
    save_episode(tasks[0], episodes[0], tmp_path / "new" / "one.png")
    save_episode_grid(tasks, episodes, tmp_path / "grid.png", "default, room", columns=2)
    for file in (tmp_path / "new" / "one.png", tmp_path / "grid.png"):
        image = cv2.imread(str(file))
        assert image is not None and image.std() > 10


def test_every_episode_needs_its_task(tmp_path):
    with pytest.raises(InputError, match="1 episodes and 0 tasks"):
        save_episode_grid([], [row_of(make_record(), 0)], tmp_path / "grid.png")
