"""Batches: the mirror is a true mirror of the world, and goals, states and rows are drawn as documented."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.perception.local_map import build_local_map
from iwalker_jax.planning.planner import PlannerConfig
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.training.batches import frame_order, gather_batch
from iwalker_jax.training.maps import TrainingData

MOUNT = np.array([0.6, 0.3, 0.15, 0.08, 0.05], np.float32)
"""A camera that is rolled and sits to the left: nothing about it is symmetric."""

GOALS = 6


def make_scene(sign: float) -> Scene:
    """Furniture ahead of the robot; `sign` -1 gives its mirror image."""
    boxes = np.array(
        [
            [2.0, 0.7, 0.4, 0.3, 0.2, 0.4, 0.5],
            [3.0, -0.9, 0.6, 0.5, 0.1, 0.6, -0.2],
            [4.5, 0.0, 1.2, 0.1, 3.0, 1.2, 0.1],
        ]
    )
    cylinders = np.array([[1.6, -0.5, 0.3, 0.12, 0.3]])
    boxes[:, [1, 6]] *= sign
    cylinders[:, 1] *= sign
    return Scene("mirror", "test", boxes, cylinders, (-2.0, -4.0, 6.0, 4.0), 2.5)


def render(scene: Scene, mount: np.ndarray) -> np.ndarray:
    rotation, position = world_camera_pose(jnp.zeros(3), jnp.asarray(mount))
    return np.asarray(render_depth(scene.arrays(), Intrinsics(), rotation, position))


def make_data(depth: np.ndarray, rows: int = 1) -> TrainingData:
    """`rows` times one image, its own local map in the maps, and goal g of frame i at (i, g)."""
    local = build_local_map(jnp.asarray(depth), jnp.asarray(MOUNT), Intrinsics())
    goals = np.stack(np.meshgrid(np.arange(rows), np.arange(GOALS), indexing="ij"), axis=-1).astype(np.float32)
    small = np.zeros((rows, GOALS, 2, 2), np.float16)
    small[:] = np.arange(GOALS)[None, :, None, None]
    return TrainingData(
        depth=jnp.asarray(np.repeat(np.round(depth * 1000)[None].astype(np.uint16), rows, axis=0)),
        mounts=jnp.tile(MOUNT, (rows, 1)),
        goals=jnp.asarray(goals),
        esdf=jnp.repeat(local.esdf[None].astype(jnp.float16), rows, axis=0),
        unknown=jnp.repeat(local.unknown[None].astype(jnp.float16), rows, axis=0),
        to_go=jnp.asarray(small),
        routes=jnp.asarray(small),
        published=jnp.repeat(local.published[None].astype(jnp.float16), rows, axis=0),
    )


def gather(data: TrainingData, index, seed: int = 0, mirror: bool = True):
    return gather_batch(data, jnp.asarray(index), jax.random.key(seed), mirror, PlannerConfig())


@pytest.fixture(scope="module")
def mirrored_row():
    """One mirrored row of a rendered frame."""
    data = make_data(render(make_scene(1.0), MOUNT))
    batch = gather(data, np.zeros(8, int))
    row = int(np.flatnonzero(np.asarray(batch.mount[:, 2]) < 0)[0])
    return jax.tree.map(lambda x: np.asarray(x[row]), batch)


def test_a_mirrored_row_is_what_the_mirrored_camera_sees_in_the_mirrored_world(mirrored_row):
    """Oracle: the ray caster on the mirror image of the scene, from the row's own mount."""
    seen = render(make_scene(-1.0), mirrored_row.mount)
    assert np.mean(np.abs(seen - mirrored_row.depth) < 2e-3) > 0.999
    assert np.mean(np.abs(render(make_scene(1.0), MOUNT) - mirrored_row.depth) < 2e-3) < 0.9


def test_a_mirrored_rows_maps_are_the_mirrored_images_own(mirrored_row):
    """Oracle: the local map built anew from the mirrored image and mount; only cells on rounding edges may differ."""
    local = build_local_map(jnp.asarray(mirrored_row.depth), jnp.asarray(mirrored_row.mount), Intrinsics())
    assert np.mean(np.asarray(local.unknown) != (mirrored_row.maps.unknown > 0.5)) < 0.01
    assert np.mean(np.abs(np.asarray(local.esdf) - mirrored_row.maps.esdf) > 0.08) < 0.01
    assert np.mean(np.abs(np.asarray(local.published) - mirrored_row.maps.published) > 0.3) < 0.01


@pytest.fixture(scope="module")
def many_rows():
    """Six hundred rows of two frames with tiny images."""
    data = make_data(render(make_scene(1.0), MOUNT), rows=2)
    tiny = data._replace(
        depth=data.depth[:, :2, :2], esdf=data.esdf[:, :2, :2], unknown=data.unknown[:, :2, :2],
        published=data.published[:, :2, :2],
    )  # fmt: skip
    index = np.arange(600) % 2
    return index, gather(tiny, index)


def test_goals_are_drawn_as_documented(many_rows):
    """Oracle: binomial shares; goal 0 is taken every third time and otherwise one in six."""
    index, batch = many_rows
    chosen = np.abs(np.asarray(batch.goal[:, 1])).astype(int)
    np.testing.assert_array_equal(batch.goal[:, 0], index)
    share = np.bincount(chosen, minlength=GOALS) / len(chosen)
    wanted = np.full(GOALS, 2 / 3 / GOALS)
    wanted[0] += 1 / 3
    np.testing.assert_array_less(np.abs(share - wanted), 4 * np.sqrt(wanted * (1 - wanted) / len(chosen)))
    # Cost-to-go and route belong to the goal that was drawn.
    np.testing.assert_array_equal(batch.maps.to_go[:, 0, 0], chosen)
    np.testing.assert_array_equal(batch.maps.route[:, 0, 0], chosen)


def test_half_the_rows_are_mirrored_and_stance_sides_are_even(many_rows):
    """Oracle: binomial shares within four standard deviations."""
    _, batch = many_rows
    for flags in (batch.mount[:, 2] < 0, batch.state.stance_sign > 0):
        assert abs(float(np.mean(flags)) - 0.5) < 4 * 0.5 / np.sqrt(600)
    mirrored = np.asarray(batch.mount[:, 2] < 0)
    moved = batch.goal[:, 1] != 0
    np.testing.assert_array_equal(np.asarray(batch.goal[:, 1] < 0), mirrored & np.asarray(moved))
    np.testing.assert_array_equal(np.asarray(batch.mount[:, 4] < 0), mirrored)
    np.testing.assert_allclose(batch.mount[:, [0, 1, 3]], np.tile(MOUNT[[0, 1, 3]], (600, 1)))


def test_rows_depend_on_their_place_and_the_key_alone(many_rows):
    """Property: a row's draw does not change with the frames in the other rows."""
    data = make_data(render(make_scene(1.0), MOUNT), rows=2)
    first, second = gather(data, [0, 1, 0], mirror=False), gather(data, [1, 1, 1], mirror=False)
    np.testing.assert_array_equal(first.goal[1], second.goal[1])
    np.testing.assert_array_equal(first.state.com_velocity, second.state.com_velocity)
    assert (np.asarray(gather(data, [0, 1, 0], seed=1).state.com_velocity) != first.state.com_velocity).any()
    assert (np.asarray(first.mount) == MOUNT).all()


def test_epochs_are_shuffled_differently_and_seeds_matter():
    first = [tuple(frame_order(0, 10, 10, epoch)) for epoch in range(4)]
    assert len(set(first)) == 4
    assert tuple(frame_order(1, 10, 10, 0)) != first[0]
    np.testing.assert_array_equal(frame_order(0, 10, 10, 2), first[2])
