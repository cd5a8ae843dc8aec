"""The NumPy geometry against the JAX one in double precision, SciPy and hand arithmetic."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from iwalker_jax.geometry import host, planar, rotations, splines

RNG = np.random.default_rng(0)
POSES, POINTS = RNG.normal(size=(6, 3)), RNG.normal(size=(6, 2))


def test_frames_in_the_plane_equal_the_jax_ones(x64):
    for own, other in ((host.to_base, planar.to_base), (host.to_world, planar.to_world)):
        poses, points = jnp.asarray(POSES), jnp.asarray(POINTS)
        np.testing.assert_allclose(own(POSES, POINTS), jax.vmap(other)(poses, points), atol=1e-14)
        np.testing.assert_allclose(own(POSES[0], POINTS), other(poses[0], points), atol=1e-14)
    np.testing.assert_allclose(host.to_world(POSES, host.to_base(POSES, POINTS)), POINTS, atol=1e-14)


def test_a_robot_that_faces_left_has_world_x_to_its_right():
    """By hand: facing along y at (1, 2), the point (3, 2) lies 2 m to the right."""
    pose = np.array([1.0, 2.0, np.pi / 2])
    np.testing.assert_allclose(host.to_base(pose, np.array([3.0, 2.0])), [0.0, -2.0], atol=1e-15)
    np.testing.assert_allclose(host.leftward(np.array([np.pi / 2])), [[-1.0, 0.0]], atol=1e-15)


def test_rotations_equal_scipys(x64):
    quaternion = RNG.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    expected = Rotation.from_quat(np.roll(quaternion, -1)).as_matrix()
    np.testing.assert_allclose(host.rotation_matrix(quaternion), expected, atol=1e-14)
    np.testing.assert_allclose(rotations.rotation_matrix(jnp.asarray(quaternion)), expected, atol=1e-14)
    about_z = Rotation.from_euler("z", 0.7).as_matrix()
    np.testing.assert_allclose(host.rotation_about_vertical(0.7), about_z, atol=1e-15)
    np.testing.assert_allclose(host.planar_rotation(0.7), about_z[:2, :2], atol=1e-15)
    np.testing.assert_allclose(host.turn(0.7, POINTS), POINTS @ about_z[:2, :2].T, atol=1e-14)


def test_angles_wrap(x64):
    """Oracle: the remainder of a division by a full turn."""
    angles = np.linspace(-20.0, 20.0, 400)
    expected = np.remainder(angles + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(host.wrap_angle(angles), expected, atol=1e-13)
    np.testing.assert_allclose(rotations.wrap_angle(jnp.asarray(angles)), expected, atol=1e-13)
    np.testing.assert_allclose(rotations.angle_between(jnp.asarray(angles), jnp.zeros(400)), expected, atol=1e-13)


def test_lengths_along_a_polyline(x64):
    path = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 6.0]])
    np.testing.assert_array_equal(host.arc_length(path), [0.0, 5.0, 7.0])
    np.testing.assert_allclose(splines.arc_length(jnp.asarray(path)), [0.0, 5.0, 7.0])
    assert host.polyline_length(path) == 7.0
    np.testing.assert_allclose(host.points_along(path, 6.0), [3.0, 5.0])
    np.testing.assert_allclose(host.points_along(path, np.array([-1.0, 2.5, 9.0])), [[0, 0], [1.5, 2.0], [3.0, 6.0]])
