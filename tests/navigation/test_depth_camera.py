"""The walking robot's depth camera: what lasts from frame to frame, and when it is drawn anew."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bruce_model import load_mujoco
from iwalker_jax.navigation.camera import load_camera
from iwalker_jax.navigation.depth_camera import start_depth_camera, take_depth
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.scenes.depth_noise import DepthNoise
from iwalker_jax.scenes.scene import Scene

FRAMES = 25
# Without what makes holes: every pixel of the wall returns in every frame.
NOISE = DepthNoise(near_holes=0.0, far_holes=0.0, edge_holes=0.0, ghosts=0.0, disparity_step=1e-4)


@pytest.fixture(scope="module")
def look():
    """Frames of a wall 3 m ahead, by the noise and by the robot's places and headings."""
    model = load_mujoco()
    camera, home = load_camera(model), jnp.asarray(model.key_qpos[0], jnp.float32)
    wall = np.array([[3.1, 0.0, 1.0, 0.1, 5.0, 2.0, 0.0]])
    scene = Scene("wall", "test", wall, np.zeros((0, 5)), (-2.0, -4.0, 4.0, 4.0)).arrays()

    @partial(jax.jit, static_argnames="noise")
    def frames(noise, xs, yaws):
        def posed(x, yaw):
            turned = jnp.stack([jnp.cos(yaw / 2), 0 * yaw, 0 * yaw, jnp.sin(yaw / 2)])
            return jnp.concatenate([home[:1] + x, home[1:3], turned, home[7:]])

        def frame(state, at):
            return take_depth(camera, Intrinsics(), noise, scene, posed(*at), state)

        start = start_depth_camera(camera, posed(xs[0], yaws[0]), jax.random.key(3))
        return jax.lax.scan(frame, start, (xs, yaws))[1]

    return frames


def mean_error(look, noise, xs, yaws):
    """Standard deviation over the upper pixels of the error that averaging all frames leaves, and of one frame's."""
    errors = np.asarray(look(noise, xs, yaws) - look(None, xs, yaws))[:, 5:40, 40:120]
    return errors.mean(axis=0).std(), errors[0].std()


def test_what_a_standing_camera_gets_wrong_does_not_average_out(look):
    """Oracle: independent errors fall with the square root of the frames; the lasting part of the model does not."""
    still = jnp.zeros(FRAMES)
    lasting, single = mean_error(look, NOISE, still, still)
    expected = single * NOISE.surface_bias / np.hypot(1.0, NOISE.surface_bias)
    assert lasting == pytest.approx(expected, rel=0.2)
    fleeting, single = mean_error(look, replace(NOISE, surface_bias=0.0), still, still)
    assert fleeting < 1.6 * single / np.sqrt(FRAMES)


@pytest.mark.parametrize("turning", [False, True])
def test_another_view_draws_other_errors(look, turning):
    """Oracle: frames of one view share their lasting errors, those of views farther apart do not."""
    there = jnp.arange(FRAMES) % 2 * 0.35
    still = jnp.zeros(FRAMES)
    moving = mean_error(look, NOISE, *((still, there) if turning else (there, still)))[0]
    assert moving < 0.5 * mean_error(look, NOISE, still, still)[0]


def test_without_noise_depth_is_ideal(look):
    depth = np.asarray(look(None, jnp.zeros(2), jnp.zeros(2)))
    np.testing.assert_array_equal(depth[0], depth[1])
    assert 2.6 < depth[0, 20, 80] < 3.1
