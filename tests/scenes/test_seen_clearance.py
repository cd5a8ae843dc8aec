"""From where a camera stands to the clearance that its depth image shows: one derivative through renderer and map."""

import jax
import jax.numpy as jnp
import numpy as np

from iwalker_jax.perception import CameraMount, GridSpec, Intrinsics, sample_bilinear, soft_map
from iwalker_jax.scenes import DepthNoise, add_depth_noise, render_depth, world_camera_pose
from iwalker_jax.scenes.scene import Scene
from tests.gradients import assert_gradients_agree

CAMERA = Intrinsics(48, 36, 24.0, 24.0, 23.5, 17.5)
GRID = GridSpec(x_min=0.0, y_min=-1.6, resolution=0.1, rows=30, columns=32)
WALL = Scene("wall", "test", np.array([[2.4, 0.0, 0.5, 0.4, 3.0, 0.5, 0.0]]), np.zeros((0, 5)), (-2.0, -4.0, 4.0, 4.0))
PLACES = jnp.asarray([[0.53, 0.12], [0.97, -0.31], [1.21, 0.04]])
MOUNT = CameraMount(pitch=0.1)
NOISE = DepthNoise(ghosts=0.0)


def clearance(pose: jax.Array, noise: DepthNoise | None = None, straight_through: bool = True) -> jax.Array:
    """(3,) [m] distances that the image of a robot at a pose shows, at places ahead of it."""
    mount = jnp.asarray(MOUNT.as_array(), pose.dtype)
    scene = jax.tree.map(lambda leaf: jnp.asarray(leaf, pose.dtype), WALL.arrays())
    depth = render_depth(scene, CAMERA, *world_camera_pose(pose, mount))
    if noise is not None:
        depth = add_depth_noise(jax.random.key(0), depth, noise, CAMERA, straight_through=straight_through)
    return sample_bilinear(soft_map(depth, mount, CAMERA, GRID).esdf, GRID, PLACES.astype(pose.dtype))


def test_clearance_feels_where_the_robot_stands(x64):
    """Oracle: central differences through ray casting, soft occupancy and distance field together."""
    assert_gradients_agree(jax.jit(clearance), jnp.asarray([0.013, 0.021, 0.03]), step=1e-7, tolerance=1e-4)


def ahead(noise: DepthNoise | None, straight_through: bool = True) -> tuple[jax.Array, jax.Array]:
    """Clearances and their derivatives by a step straight ahead."""
    stepped = jax.jit(lambda step: clearance(jnp.stack([step, 0.0, 0.0]), noise, straight_through))
    return jax.jvp(stepped, (jnp.asarray(0.0),), (jnp.asarray(1.0),))


def test_a_step_towards_a_wall_costs_a_step_of_clearance():
    """Oracle: geometry, a face at x = 2 m straight ahead."""
    found, slope = ahead(None)
    np.testing.assert_allclose(found, 2.0 - PLACES[:, 0] - 0.05, atol=0.02)
    np.testing.assert_allclose(slope, -1.0, atol=0.02)


def test_noise_keeps_the_derivative_straight_through_its_rounding_alone():
    """Oracle: the sign; points that also move in and out of cells change it. Zero through the rounding itself."""
    found, slope = ahead(NOISE)
    np.testing.assert_allclose(found, 2.0 - PLACES[:, 0] - 0.05, atol=0.06)
    assert np.all((slope < -0.4) & (slope > -1.6))
    np.testing.assert_array_equal(ahead(NOISE, straight_through=False)[1], 0)
