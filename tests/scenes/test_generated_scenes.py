"""Generated scenes: reproducible, roomy, connected; held-out ones apart from every training layout."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.scenes.built.free_space import connected_free_space
from iwalker_jax.scenes.built.held_out_scenes import held_out_scene
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES, held_out_sequence
from iwalker_jax.scenes.built.layout import HELD_OUT_STYLE, TRAINING_STYLE
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import SMALL, Scene, obstacle_distance


def has_oblique_walls(scene: Scene) -> bool:
    """Whether a piece of wall longer than 1.5 m reaches the ceiling and stands well off both axes."""
    length, height = 2 * scene.boxes[:, 3], scene.boxes[:, 2] + scene.boxes[:, 5]
    off_axis = abs(np.sin(2 * scene.boxes[:, 6])) > 0.12
    return bool((off_axis & (length > 1.5) & (abs(height - scene.ceiling) < 1e-9)).any())


def flood(free: np.ndarray) -> np.ndarray:
    """Cells of the largest 4-connected region, by repeated dilation from each unvisited cell."""
    best, left = np.zeros_like(free), free.copy()
    while left.sum() > best.sum():
        region = np.zeros_like(free)
        region[tuple(np.argwhere(left)[0])] = True
        while True:
            grown = region.copy()
            grown[1:] |= region[:-1]
            grown[:-1] |= region[1:]
            grown[:, 1:] |= region[:, :-1]
            grown[:, :-1] |= region[:, 1:]
            grown &= free
            if (grown == region).all():
                break
            region = grown
        left &= ~region
        best = region if region.sum() > best.sum() else best
    return best


@pytest.mark.parametrize("family", FAMILIES)
def test_scenes_are_reproducible_distinct_and_connected(family):
    """Oracle: the generator's promises, checked on several seeds, with a flood fill of its own for one of them."""
    scenes = [generate_scene(family, seed) for seed in range(4)]
    again = generate_scene(family, 2)
    np.testing.assert_array_equal(scenes[2].boxes, again.boxes)
    np.testing.assert_array_equal(scenes[2].cylinders, again.cylinders)
    assert len({scene.ceiling for scene in scenes}) == 4
    for scene in scenes:
        assert scene.family == family
        assert len(scene.boxes) <= SMALL.boxes and len(scene.cylinders) <= SMALL.cylinders
        area, share = connected_free_space(scene)
        assert area >= 5.0 and share >= 0.85
    scene, step = scenes[0], 0.1
    x_min, y_min, x_max, y_max = scene.bounds
    x, y = np.arange(x_min + step / 2, x_max, step), np.arange(y_min + step / 2, y_max, step)
    points = jnp.asarray(np.stack(np.meshgrid(x, y, indexing="ij"), -1), float)
    free = np.asarray(obstacle_distance(scene.arrays(), points)) > BODY.layout_radius
    region = flood(free)
    area, share = connected_free_space(scene)
    assert abs(region.sum() * step**2 - area) < 0.05 * area
    assert abs(region.sum() / free.sum() - share) < 0.03


def test_camera_sees_structure_in_every_family():
    """Oracle: edges of depth between neighbouring pixels, of which an empty room of the same size shows none."""
    intrinsics = Intrinsics(40, 24, 20.0, 20.0, 19.5, 11.5)
    render = jax.jit(
        jax.vmap(lambda s, pose, m: render_depth(s, intrinsics, *world_camera_pose(pose, m)), in_axes=(None, 0, None))
    )
    rng = np.random.default_rng(0)
    mount = CameraMount().as_array()
    empty = Scene("empty", "empty", np.empty((0, 7)), np.empty((0, 5)), (0.0, 0.0, 9.0, 9.0), 2.6)
    for scenes in ([empty], *([generate_scene(family, seed) for seed in range(3)] for family in FAMILIES)):
        edges = []
        for scene in scenes:
            arrays = scene.arrays()
            points = rng.uniform(scene.bounds[:2], scene.bounds[2:], (200, 2))
            free = points[np.asarray(obstacle_distance(arrays, jnp.asarray(points, jnp.float32))) > 0.3][:24]
            poses = np.concatenate([free, rng.uniform(-3, 3, (len(free), 1))], axis=1)
            depth = np.asarray(render(arrays, jnp.asarray(poses, jnp.float32), mount))
            assert ((depth > 0).mean(axis=(1, 2)) > 0.3).all()
            jumps = (abs(np.diff(depth, axis=2)) > 0.25) & (depth[:, :, 1:] > 0) & (depth[:, :, :-1] > 0)
            edges += list(jumps.sum(axis=(1, 2)))
        if scenes[0] is empty:
            assert max(edges) == 0
        else:
            assert np.mean(edges) > 5 and np.mean(np.asarray(edges) > 2) > 0.4, (scenes[0].family, edges)


def test_held_out_styles_lie_outside_training():
    """Oracle: interval arithmetic on the styles, then the numbers and walls of generated scenes themselves."""
    for name in ("ceiling", "wall_thickness"):
        assert getattr(HELD_OUT_STYLE, name)[0] > getattr(TRAINING_STYLE, name)[1]
    training = [generate_scene(family, seed) for family in FAMILIES for seed in range(6)]
    held_out = [held_out_scene(seed) for seed in range(12)]
    held_out += [held_out_sequence(name).scene for name in SEQUENCE_NAMES]
    low, high = TRAINING_STYLE.ceiling
    assert all(low <= scene.ceiling <= high for scene in training)
    assert all(scene.ceiling > high for scene in held_out)
    assert not any(has_oblique_walls(scene) for scene in training)
    assert all(has_oblique_walls(scene) for scene in held_out)


def test_held_out_scenes_are_reproducible_and_connected():
    """Oracle: the same seed again, other seeds differ, free space as promised."""
    np.testing.assert_array_equal(held_out_scene(5).boxes, held_out_scene(5).boxes)
    assert len({held_out_scene(seed).ceiling for seed in range(6)}) == 6
    for seed in range(6):
        area, share = connected_free_space(held_out_scene(seed))
        assert area >= 5.0 and share >= 0.85


@pytest.mark.parametrize("name", ["stair", "office", "corridor", "corner"])
def test_sequences_have_walkable_routes(name):
    """Oracle: clearance sampled each 2 cm of the route; its length, its turns and its end."""
    sequence = held_out_sequence(name)
    steps = np.diff(sequence.route, axis=0)
    lengths = np.hypot(*steps.T)
    assert 5.0 <= lengths.sum() <= 12.5
    headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    assert abs(headings[-1] - headings[0]) > math.radians(25) or abs(np.diff(headings)).sum() > math.radians(60)
    dense = np.concatenate(
        [
            a + np.linspace(0, 1, int(n / 0.02) + 2)[:, None] * (b - a)
            for a, b, n in zip(sequence.route[:-1], sequence.route[1:], lengths, strict=True)
        ]
    )
    clearance = np.asarray(obstacle_distance(sequence.scene.arrays(), jnp.asarray(dense, jnp.float32)))
    assert clearance.min() > 0.3
    assert sequence.goal == tuple(sequence.route[-1])
    area, share = connected_free_space(sequence.scene)
    assert area > 15.0 and share > 0.9


def test_bad_requests_are_refused():
    with pytest.raises(InputError, match="Unknown scene family"):
        generate_scene("spaceship", 0)
    with pytest.raises(InputError, match="negative"):
        generate_scene(FAMILIES[0], -1)
    with pytest.raises(InputError, match="negative"):
        held_out_scene(-1)
    with pytest.raises(InputError, match="Unknown test sequence"):
        held_out_sequence("roof")
