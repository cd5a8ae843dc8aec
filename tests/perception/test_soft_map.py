"""Soft maps: derivatives in depth pixels against central differences, values against the hard map and known walls."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.collision_map import DEFAULT_OBSTACLES, occupancy_map
from iwalker_jax.perception.cost_to_go import UNREACHABLE, cost_to_go
from iwalker_jax.perception.depth_cleanup import clean_depth
from iwalker_jax.perception.distance_field import signed_distance_field
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.local_map import build_local_map
from iwalker_jax.perception.map_sampling import sample_bilinear
from iwalker_jax.perception.soft_map import SoftOccupancy, soft_map
from iwalker_jax.perception.traversal import TraversalParameters, traversal_cost
from tests.gradients import assert_gradients_agree
from tests.perception.box_scene import render

CAMERA = Intrinsics(40, 30, 20.0, 20.0, 19.5, 14.5)
MOUNT = CameraMount(pitch=0.1)
GRID = GridSpec(x_min=0.0, y_min=-1.6, resolution=0.1, rows=30, columns=32)
ROOM = [(2.0, 2.3, -0.5, 0.2, 0.0, 0.7), (2.63, 2.9, -9.0, 9.0, 0.0, 0.7)]
PATH = jnp.asarray([[0.33, 0.02], [0.91, 0.11], [1.32, 0.23], [1.71, -0.12]])

softly = jax.jit(soft_map, static_argnums=(2, 3, 4, 5))
build = jax.jit(build_local_map, static_argnums=(2, 3), static_argnames="soft")


def seen(boxes=ROOM, dtype=jnp.float64):
    return jnp.asarray(render(CAMERA, MOUNT, boxes), dtype)


def mount(dtype=jnp.float64):
    return jnp.asarray(MOUNT.as_array(), dtype)


def test_distances_along_a_path_feel_the_depth_pixels(x64):
    """Oracle: central differences of the soft map, forward and reverse mode; in the camera's mount as well."""

    @jax.jit
    def clearance(depth, mount):
        return sample_bilinear(softly(depth, mount, CAMERA, GRID).esdf, GRID, PATH.astype(jnp.float64))

    depth = seen() + 1e-3 * jnp.asarray(np.random.default_rng(0).normal(size=(30, 40)))
    depth = jnp.where(seen() > 0, depth, 0.0)
    slope = jax.grad(lambda d: jnp.sum(clearance(d, mount())))(depth)
    assert jnp.all(jnp.isfinite(slope)) and not jnp.any(slope[depth == 0])
    # No return stays none: a direction that makes one of it leaves the map's domain.
    assert_gradients_agree(lambda d: clearance(jnp.where(depth > 0, d, 0.0), mount()), depth, step=1e-7, tolerance=1e-4)
    assert_gradients_agree(lambda m: clearance(depth, m), mount(), step=1e-7, tolerance=1e-4)


def test_the_degree_of_occupancy_feels_the_depth_pixels(x64):
    """Oracle: central differences."""
    depth = seen() + 1e-3 * jnp.asarray(np.random.default_rng(1).normal(size=(30, 40)))

    def occupancy(d):
        return softly(jnp.where(seen() > 0, d, 0.0), mount(), CAMERA, GRID).occupancy

    assert_gradients_agree(occupancy, depth, step=1e-7, tolerance=1e-4)


def test_a_wall_that_moves_moves_the_field_by_as_much(x64):
    """Oracle: geometry; the distance to a wall ahead, whatever cells it lies in, and its derivative by the place."""
    level = CameraMount(pitch=0.0)

    @jax.jit
    def ahead(depth, change):
        moved = jnp.where(depth > 0, depth + change, 0.0)
        return softly(moved, jnp.asarray(level.as_array(), jnp.float64), CAMERA, GRID).esdf[10:15, 16]

    for place in (2.03, 2.05, 2.08, 2.11):
        # A level camera's z-depth is the distance ahead.
        depth = jnp.asarray(render(CAMERA, level, [(place, 3.0, -9.0, 9.0, 0.0, 0.7)], floor=False), jnp.float64)
        distance, slope = jax.jvp(lambda change, depth=depth: ahead(depth, change), (0.0,), (1.0,))
        np.testing.assert_allclose(distance, place - GRID.centres()[10:15, 16, 0] - 0.05, atol=0.01)
        np.testing.assert_allclose(slope, 1.0, atol=0.01)


def test_a_room_that_recedes_moves_the_soft_field_without_jumps(x64):
    """Oracle: how far its points move; the hard field, of the same images, jumps by whole cells."""
    steps, each = 100, 2.5e-4
    grown = jax.vmap(lambda n: seen() * (1.0 + each * n))(jnp.arange(float(steps)))
    soft = jax.jit(jax.vmap(lambda depth: soft_map(depth, mount(), CAMERA, GRID)))(grown)
    hard = jax.jit(jax.vmap(lambda depth: occupancy_map(depth, mount(), CAMERA, GRID)))(grown)
    farthest = 3.5  # [m] from the camera to the map's corners, which are all that counts
    assert np.abs(np.diff(soft.esdf, axis=0)).max() < 2 * each * farthest
    assert np.abs(np.diff(soft.occupancy, axis=0)).max() < 0.2
    assert np.any(np.diff(np.asarray(hard, int), axis=0))


@pytest.mark.parametrize("seed", range(4))
def test_as_the_ramps_go_to_zero_the_occupancy_is_the_hard_one(seed, x64):
    """Oracle: the hard map, exactly, and its field up to what cells round away: half their diagonal."""
    noise = 0.03 * np.random.default_rng(seed).normal(size=(30, 40)) * (np.asarray(seen()) > 0)
    depth = seen() + jnp.asarray(noise)
    occupied = occupancy_map(depth, mount(), CAMERA, GRID)
    steep = softly(depth, mount(), CAMERA, GRID, DEFAULT_OBSTACLES, SoftOccupancy(1e-9, 1e-9, 1e-9))
    np.testing.assert_array_equal(steep.occupancy, np.asarray(occupied, float))
    field = signed_distance_field(occupied, GRID.resolution)
    np.testing.assert_array_less(np.abs(steep.esdf - field), GRID.resolution / np.sqrt(2) + 1e-6)


def test_the_default_ramps_agree_with_the_hard_map_where_it_is_sure(x64):
    """Oracle: the hard map; away from surfaces fields differ by less than a cell, in the median by half of one."""
    hard = occupancy_map(seen(), mount(), CAMERA, GRID)
    soft = softly(seen(), mount(), CAMERA, GRID)
    occupancy = np.asarray(soft.occupancy)
    assert occupancy.min() == 0.0 and occupancy.max() == 1.0
    sure = (occupancy == 0.0) | (occupancy == 1.0)
    assert sure.mean() > 0.9 and (np.asarray(hard)[sure] == (occupancy[sure] == 1.0)).mean() > 0.97
    field = np.asarray(signed_distance_field(hard, GRID.resolution))
    apart = np.abs(soft.esdf - field)[field > 0.25]
    assert apart.size > 200 and apart.max() < GRID.resolution and np.median(apart) < 0.5 * GRID.resolution


def test_the_local_map_takes_it_by_a_flag(unchecked_types):
    """Oracle: the soft map of the cleaned image; the other maps stay, bit for bit, and without derivative."""
    depth = seen(dtype=jnp.float32)
    hard = build(depth, mount(jnp.float32), CAMERA, GRID)
    soft = build(depth, mount(jnp.float32), CAMERA, GRID, soft=SoftOccupancy())
    for name in ("occupied", "known_free", "unknown", "published"):
        np.testing.assert_array_equal(getattr(soft, name), getattr(hard, name))
    np.testing.assert_allclose(soft.esdf, softly(clean_depth(depth), mount(jnp.float32), CAMERA, GRID).esdf, atol=1e-6)

    def total(depth, mount, name, soft):
        return jnp.sum(getattr(build(depth, mount, CAMERA, GRID, soft=soft), name))

    slope = jax.grad(total, argnums=(0, 1))
    for name, given in (("esdf", None), ("published", None), ("published", SoftOccupancy())):
        assert not any(jnp.any(part) for part in slope(depth, mount(jnp.float32), name, given))
    for part in slope(depth, mount(jnp.float32), "esdf", SoftOccupancy()):
        assert jnp.all(jnp.isfinite(part)) and jnp.any(part)
    with pytest.raises(InputError, match="soft=SoftOccupancy"):
        build_local_map(depth, mount(jnp.float32), CAMERA, GRID, soft=0.1)


def test_the_cost_of_the_best_route_feels_the_depth_image(x64):
    """Oracle: central differences through soft map, traversal cost and cost-to-go together."""
    depth = seen() + 1e-3 * jnp.asarray(np.random.default_rng(2).normal(size=(30, 40)))
    goal = jnp.asarray([2.47, 0.46])

    @jax.jit
    def to_go(d):
        clearance = softly(jnp.where(seen() > 0, d, 0.0), mount(), CAMERA, GRID).esdf
        cost = traversal_cost(clearance, jnp.zeros(GRID.shape), TraversalParameters())
        return cost_to_go(cost, goal, GRID).value.cost[5:20:3, 12:20:3]

    assert jnp.all(to_go(depth) < UNREACHABLE)
    assert_gradients_agree(to_go, depth, step=1e-7, tolerance=1e-4)


@pytest.mark.parametrize(("value", "pitch"), [(0.0, 0.1), (0.3, 0.1), (60.0, 0.1), (0.4, np.pi / 2)])
def test_useless_frames_give_finite_maps_and_derivatives(value, pitch):
    """Oracle: the documented diagonal where nothing is occupied; one camera looks straight down by its axis."""
    camera = Intrinsics(41, 31, 20.0, 20.0, 20.0, 15.0)
    looking = jnp.asarray(CameraMount(pitch=pitch).as_array())

    @jax.jit
    def maps(depth, mount):
        return soft_map(depth, mount, camera, GRID)

    found, pull_back = jax.vjp(maps, jnp.full((31, 41), value), looking)
    assert all(jnp.all(jnp.isfinite(part)) for part in (*found, *pull_back(jax.tree.map(jnp.ones_like, found))))
    if value == 0.0:
        np.testing.assert_allclose(found.esdf, np.hypot(3.0, 3.2), rtol=1e-6)


def test_batches_equal_a_loop():
    """Oracle: the images one by one, values and derivatives."""
    depths = jnp.stack([seen(dtype=jnp.float32), seen(ROOM[:1], jnp.float32), jnp.zeros((30, 40))])
    mounts = mount(jnp.float32) + jnp.asarray([[0.0], [0.01], [0.0]])

    def near(depth, mount):
        esdf = soft_map(depth, mount, CAMERA, GRID).esdf
        return jnp.sum(sample_bilinear(esdf, GRID, PATH)), esdf

    single = jax.value_and_grad(near, has_aux=True)
    many = jax.jit(jax.vmap(single))(depths, mounts)
    single = jax.jit(single)
    for n in range(3):
        for ours, alone in zip(jax.tree.leaves(many), jax.tree.leaves(single(depths[n], mounts[n])), strict=True):
            np.testing.assert_allclose(ours[n], alone, atol=2e-5)


@pytest.mark.parametrize(
    "changes",
    [{"height_ramp": 0.0}, {"border_ramp": 1.5}, {"count_ramp": 3.0}, {"penalty": -1.0}, {"penalty": np.nan}],
)
def test_impossible_ramps_are_refused(changes):
    with pytest.raises(InputError, match="SoftOccupancy"):
        SoftOccupancy(**changes)
