"""Faults in time, and when a camera counts as failed. Oracles: frames counted by hand, distances to a box by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.camera_health import HealthParameters, check_camera, healthy_camera
from iwalker_jax.navigation.faults import make_faults, obstacles_at, within
from iwalker_jax.scenes.scene import Scene, obstacle_distance

PARAMETERS = HealthParameters()
RNG = np.random.default_rng(0)


def live() -> jnp.ndarray:
    return jnp.asarray(RNG.uniform(0.5, 3.0, (6, 8)), jnp.float32)


def watch(frames, speed: float = 0.2):
    """Health after frames in a row."""
    health = healthy_camera((6, 8), jnp.float32)
    seen = []
    for frame in frames:
        health = check_camera(PARAMETERS, health, frame, jnp.asarray(speed))
        seen.append(bool(health.failed))
    return seen


def test_a_live_camera_is_trusted():
    assert not any(watch([live() for _ in range(10)]))


@pytest.mark.parametrize("frame", [jnp.zeros((6, 8)), jnp.full((6, 8), jnp.nan)])
def test_a_blind_camera_fails_after_a_few_frames_and_recovers(frame):
    seen = watch([live(), *[frame] * 4, live()])
    assert seen == [False, False, False, True, True, False]


def test_a_frozen_camera_fails_and_stays_so_while_the_robot_stands():
    frozen = live()
    assert watch([frozen] * 5) == [False, False, False, True, True]
    health = healthy_camera((6, 8), jnp.float32)
    for speed in (0.2, 0.2, 0.2, 0.2, 0.0, 0.0):
        health = check_camera(PARAMETERS, health, frozen, jnp.asarray(speed))
    assert bool(health.failed)
    assert not bool(check_camera(PARAMETERS, health, live(), jnp.asarray(0.0)).failed)


def test_a_robot_at_rest_may_see_the_same_image_twice():
    assert not any(watch([live()] * 8, speed=0.0))


def test_a_box_comes_and_goes():
    """Oracle: the distance to the box by hand."""
    scene = Scene("open", "test", np.zeros((0, 7)), np.zeros((0, 5)), (-3, -3, 3, 3)).arrays()
    faults = make_faults(box=(1.0, 0.0, 0.5, 0.2, 0.2, 0.5, 0.0), present=(2.0, 4.0))
    at = jnp.zeros(2)
    for time, wanted in ((0.0, None), (2.0, 0.8), (3.9, 0.8), (4.0, None)):
        distance = float(obstacle_distance(obstacles_at(faults, scene, jnp.asarray(time)), at))
        assert distance > 100 if wanted is None else distance == pytest.approx(wanted, abs=1e-6)
    assert not within(make_faults().blind, jnp.asarray(1e6))


@pytest.mark.parametrize("wrong", [{"blind": (3.0, 1.0)}, {"box": (0.0,) * 7}])
def test_useless_faults_are_refused(wrong):
    with pytest.raises(InputError, match="Faults"):
        make_faults(**wrong)
