"""Which derivatives of the maps exist: central differences where they do, zeros where something is counted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.cost_to_go import cost_to_go, descend
from iwalker_jax.perception.depth_cleanup import clean_depth
from iwalker_jax.perception.floor import align_to_floor, fit_floor
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.local_map import LocalMap, build_local_map
from iwalker_jax.perception.seen_route import ROUTE_POINTS, best_routes
from tests.gradients import assert_gradients_agree
from tests.perception.box_scene import render

CAMERA = Intrinsics(40, 30, 20.0, 20.0, 19.5, 14.5)
MOUNT = CameraMount(pitch=0.3, roll=0.05)
ROOM = [(2.0, 2.3, -0.5, 0.2, 0.0, 0.7), (2.63, 2.9, -9.0, 9.0, 0.0, 0.7)]
GRID = GridSpec(x_min=-0.3, y_min=-1.0, resolution=0.1, rows=24, columns=20)


def seen() -> np.ndarray:
    rng = np.random.default_rng(0)
    depth = render(CAMERA, MOUNT, ROOM)
    return (depth + 2e-3 * rng.normal(size=depth.shape) * (depth > 0)).astype(np.float32)


def test_cleaned_depth_has_the_derivative_of_what_is_kept():
    """Oracle: by hand; one for pixels that are kept, zero for speckles and for what returned nothing."""
    depth = jnp.asarray(seen()).at[5, 7].set(0.4).at[9, 9].set(jnp.nan).at[3, 3].set(0.0)
    cleaned, forward = jax.jvp(clean_depth, (depth,), (jnp.ones_like(depth),))
    assert 0 < np.sum(cleaned > 0) < np.sum(np.asarray(depth) > 0)
    np.testing.assert_array_equal(forward, cleaned > 0)
    np.testing.assert_array_equal(jax.grad(lambda d: jnp.sum(clean_depth(d)))(depth), cleaned > 0)


def test_the_fitted_floor_feels_the_depth_image(x64):
    """Oracle: central differences of height, pitch and roll; the share of pixels on the floor is counted."""
    depth = jnp.asarray(seen(), jnp.float64)

    @jax.jit
    def pose(values):
        return fit_floor(jnp.where(depth > 0, values, 0.0), CAMERA).mount()[:3]

    assert fit_floor(depth, CAMERA).valid
    assert_gradients_agree(pose, depth, tolerance=1e-4)
    slope = jax.grad(lambda values: fit_floor(values, CAMERA).inlier_fraction)(depth)
    np.testing.assert_array_equal(slope, 0)


def test_an_aligned_mount_feels_the_depth_image_and_the_believed_mount(x64):
    """Oracle: central differences; zero where the floor may correct no more."""
    depth, believed = jnp.asarray(seen(), jnp.float64), MOUNT.as_array().astype(jnp.float64)
    believed = believed + jnp.asarray([0.003, 0.005, -0.004, 0.0, 0.0])

    @jax.jit
    def aligned(values, mount):
        return align_to_floor(jnp.where(depth > 0, values, 0.0), mount, CAMERA)

    assert_gradients_agree(lambda values: aligned(values, believed), depth, tolerance=1e-4)
    assert_gradients_agree(lambda mount: aligned(depth, mount), believed, tolerance=1e-4)
    lifted = jax.jacrev(lambda values: aligned(values, believed.at[0].add(0.014))[0])(depth)
    np.testing.assert_array_equal(lifted, 0)


@pytest.mark.parametrize("name", LocalMap._fields)
def test_hard_maps_are_constant_between_their_jumps(name):
    """Oracle: the maps of an image and a mount moved by a hair, bit for bit; derivatives of zero, both modes."""
    depth, mount = jnp.asarray(seen()), MOUNT.as_array()
    build = jax.jit(lambda depth, mount: getattr(build_local_map(depth, mount, CAMERA, GRID), name))
    hair = 1e-6 * np.random.default_rng(1).normal(size=depth.shape).astype(np.float32)
    value = build(depth, mount)
    np.testing.assert_array_equal(build(depth * (1 + hair), mount), value)
    np.testing.assert_array_equal(build(depth, mount * (1 + 1e-6)), value)

    numbers = jax.jit(lambda depth, mount: build(depth, mount).astype(jnp.float32))
    _, along = jax.jvp(numbers, (depth, mount), (jnp.ones_like(depth), jnp.ones_like(mount)))
    np.testing.assert_array_equal(along, 0)
    for part in jax.vjp(numbers, depth, mount)[1](jnp.ones(value.shape)):
        np.testing.assert_array_equal(part, 0)


def test_routes_are_lists_of_cells():
    """Oracle: the same routes of costs moved by a hair, up to their own rounding; derivatives of zero, both modes."""
    rng = np.random.default_rng(3)
    cost, goal = jnp.asarray(rng.uniform(1.0, 4.0, GRID.shape), jnp.float32), jnp.asarray([1.72, 0.63])
    to_go = cost_to_go(cost, goal, GRID).value.cost

    def cells(to_go):
        return descend(to_go, GRID, jnp.zeros(2), 40)

    def route(to_go, unknown):
        return best_routes(to_go, unknown, goal, grid=GRID).seen

    unknown = jnp.asarray(rng.uniform(0.0, 0.4, GRID.shape), jnp.float32)
    np.testing.assert_array_equal(cells(to_go * (1 + 1e-6)), cells(to_go))
    np.testing.assert_array_equal(route(to_go * (1 + 1e-6), unknown * (1 + 1e-6)), route(to_go, unknown))
    ones = jnp.ones(GRID.shape)
    for function, inputs in ((cells, (to_go,)), (route, (to_go, unknown))):
        value, along = jax.jvp(function, inputs, (ones,) * len(inputs))
        np.testing.assert_array_equal(along, 0)
        for part in jax.vjp(function, *inputs)[1](jnp.ones_like(value)):
            np.testing.assert_array_equal(part, 0)


def test_a_route_feels_its_ends(x64):
    """Oracle: central differences in start and goal, within their cells."""
    cost = jnp.asarray(np.random.default_rng(3).uniform(1.0, 4.0, GRID.shape))
    start, goal = jnp.asarray([0.013, -0.021]), jnp.asarray([1.72, 0.63])
    to_go = cost_to_go(cost, goal, GRID).value.cost

    @jax.jit
    def route(start, goal):
        return best_routes(to_go, jnp.zeros(GRID.shape), goal, start, GRID).whole

    assert route(start, goal).shape == (ROUTE_POINTS, 2)
    np.testing.assert_allclose(route(start, goal)[-1], goal, atol=1e-12)
    assert_gradients_agree(route, start, goal)
