"""Camera paths in generated scenes: reproducible, evenly spread, and true about where they are and what they reach.

Ground truth comes from a distance to boxes and cylinders written apart from the library, and from SciPy's labelling.
"""

from collections import Counter

import numpy as np
import pytest
from scipy import ndimage

from iwalker_jax.data.camera_path import record_camera_path
from iwalker_jax.data.from_scenes import generate_training_frames
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.errors import InputError
from iwalker_jax.perception.camera import Intrinsics
from iwalker_jax.scenes.built.training_scenes import generate_scene
from iwalker_jax.scenes.routes import RouteParameters
from iwalker_jax.scenes.scene import Scene

TINY = Intrinsics(8, 6, 4.0, 4.0, 3.5, 2.5)
"""Images too small to look at: these tests are about poses and goals."""

SAMPLING = CameraPathSampling(frames_per_path=4, goals_per_frame=8)
FAMILIES = ("corridor_doors", "kitchen", "warehouse")
RADIUS = RouteParameters().inflated_radius


def tiny_frames(count, seed=0, families=FAMILIES, sampling=SAMPLING):
    return generate_training_frames(count, seed, families, sampling, TINY, noise=None)


@pytest.fixture(scope="module")
def frames():
    return tiny_frames(49)


@pytest.fixture(scope="module")
def scenes(frames):
    """The layouts behind the frames, generated again from their names."""
    return [generate_scene(*_family_and_seed(name)) for name in frames.scene_names]


def _family_and_seed(name: str) -> tuple[str, int]:
    family, _, seed = name.rpartition("-")
    return family, int(seed)


def clearance(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Plan-view distance [m] from points (n, 2) to whatever stands between 5 and 75 cm above the floor."""
    distance = np.full(len(points), np.inf)
    for x, y, z, hx, hy, hz, yaw in scene.boxes:
        if z - hz >= 0.75 or z + hz <= 0.05:
            continue
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        beyond = np.abs((points - (x, y)) @ turn.T) - (hx, hy)
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        distance = np.minimum(distance, outside + np.minimum(beyond.max(axis=1), 0.0))
    for x, y, z, radius, hz in scene.cylinders:
        if z - hz < 0.75 and z + hz > 0.05:
            distance = np.minimum(distance, np.linalg.norm(points - (x, y), axis=1) - radius)
    return distance


def in_world(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, ..., 2) of each pose's base frame in the world."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    turn = np.stack([np.stack([cos, -sin], -1), np.stack([sin, cos], -1)], -2)
    return np.einsum("nij,n...j->n...i", turn, points) + poses[:, None, :2]


def regions(scene: Scene) -> np.ndarray:
    """Connected regions (4-neighbours, 0 = blocked) of the 10 cm cells in which the inflated footprint fits."""
    x0, y0, x1, y1 = scene.bounds
    x, y = np.arange(x0 + 0.05, x1, 0.1), np.arange(y0 + 0.05, y1, 0.1)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    free = clearance(scene, points.reshape(-1, 2)).reshape(points.shape[:2]) > RADIUS
    return ndimage.label(free)[0]


def region_around(labels: np.ndarray, scene: Scene, point: np.ndarray) -> set[int]:
    """Regions of the cell of a point and its neighbours."""
    i, j = np.floor((point - scene.bounds[:2]) / 0.1).astype(int)
    return set(labels[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].ravel()) - {0}


def test_the_same_seed_gives_the_same_frames():
    """With full images and sensor noise."""
    sampling = CameraPathSampling(frames_per_path=4, goals_per_frame=3)
    one, again = (
        generate_training_frames(8, seed=5, families=("lobby", "open_office"), sampling=sampling) for _ in range(2)
    )
    for name in ("depth", "mounts", "goals", "poses", "scene_index"):
        np.testing.assert_array_equal(getattr(again, name), getattr(one, name))
    assert again.scene_names == one.scene_names and again.camera == one.camera


def test_different_seeds_give_different_layouts_paths_and_images():
    first, second = (tiny_frames(3, seed=seed) for seed in (1, 2))
    assert not set(first.scene_names) & set(second.scene_names)
    assert not np.isclose(first.poses, second.poses).all(axis=1).any()
    assert (first.depth != second.depth).any()


def test_count_and_even_spread_over_families(frames, scenes):
    """Oracle: counting; 49 frames over three families are 17, 16 and 16, four a layout at most."""
    names = [frames.scene_names[i] for i in frames.scene_index]
    assert Counter(_family_and_seed(name)[0] for name in names) == dict(zip(FAMILIES, (17, 16, 16)))
    assert max(Counter(names).values()) == SAMPLING.frames_per_path
    assert len(set(frames.scene_names)) == len(frames.scene_names)
    assert (np.diff(frames.scene_index) >= 0).all()
    assert [scene.name for scene in scenes] == list(frames.scene_names)


def test_the_body_fits_at_every_pose(frames, scenes):
    for i, scene in enumerate(scenes):
        poses = frames.poses[frames.scene_index == i]
        assert clearance(scene, poses[:, :2]).min() > SAMPLING.min_clearance - 1e-3
        low, high = np.array(scene.bounds[:2]), np.array(scene.bounds[2:])
        assert ((poses[:, :2] > low) & (poses[:, :2] < high)).all()


def test_the_first_goal_is_the_routes_end_and_reachable(frames, scenes):
    """Oracle: SciPy's connected components of the cells where the inflated footprint fits."""
    for i, scene in enumerate(scenes):
        chosen = frames.scene_index == i
        poses, goals = frames.poses[chosen], in_world(frames.poses[chosen], frames.goals[chosen, :1])[:, 0]
        np.testing.assert_allclose(goals, np.broadcast_to(goals[0], goals.shape), atol=1e-4)
        labels = regions(scene)
        home = region_around(labels, scene, goals[0])
        for pose in poses:
            assert home & region_around(labels, scene, pose[:2])
        # The path approaches its end and its recording stops before it.
        distance = np.linalg.norm(poses[:, :2] - goals, axis=1)
        assert distance.min() > 0.4
        assert len(poses) == 1 or distance[0] > distance[-1]
        assert SAMPLING.min_route / 2 < distance[0] < SAMPLING.max_route


def test_no_goal_lies_inside_an_obstacle_or_out_of_reach(frames, scenes):
    """Oracle: the re-derived distance and SciPy's components."""
    for i, scene in enumerate(scenes):
        chosen = frames.scene_index == i
        goals = in_world(frames.poses[chosen], frames.goals[chosen])
        assert clearance(scene, goals.reshape(-1, 2)).min() > RADIUS - 1e-3
        labels = regions(scene)
        home = region_around(labels, scene, goals[0, 0])
        for goal in goals.reshape(-1, 2):
            assert home & region_around(labels, scene, goal)


def test_other_goals_are_spread_over_distances_mostly_ahead(frames):
    distance = np.linalg.norm(frames.goals[:, 1:], axis=-1)
    assert distance.min() > 0.5 - 1e-4 and distance.max() < SAMPLING.goal_radius
    quarters = np.histogram(distance, bins=4, range=(0.5, 4.5))[0]
    assert quarters.min() > 0.08 * distance.size
    bearing = np.abs(np.arctan2(frames.goals[:, 1:, 1], frames.goals[:, 1:, 0]))
    ahead = np.mean(bearing < np.radians(65))
    assert 0.75 < ahead < 0.99


def test_mount_statistics():
    """Oracle: the sampling's own means and spreads, within four standard errors."""
    sampling = CameraPathSampling(frames_per_path=5, goals_per_frame=1)
    frames = tiny_frames(200, seed=3, families=("open_office",), sampling=sampling)
    assert len(frames.scene_names) == 40
    mounts = frames.mounts.reshape(40, 5, 5).astype(np.float64)
    path, sway = mounts.mean(axis=1), mounts - mounts.mean(axis=1, keepdims=True)
    means = [sampling.height, sampling.pitch, 0.0]
    spreads = np.array([sampling.height_spread, sampling.pitch_spread, sampling.roll_spread])
    sways = np.array([sampling.sway_height, sampling.sway_angle, sampling.sway_angle])
    between = np.sqrt(spreads**2 + sways**2 / 5)
    np.testing.assert_array_less(np.abs(path.mean(axis=0)[:3] - means), 4 * between / np.sqrt(40))
    np.testing.assert_allclose(path.std(axis=0, ddof=1)[:3], between, rtol=4 / np.sqrt(2 * 39))
    within = np.sqrt((sway[..., :3] ** 2).sum(axis=(0, 1)) / (40 * 4))
    np.testing.assert_allclose(within, sways, rtol=4 / np.sqrt(2 * 160))
    place = mounts[..., 3:].reshape(-1, 2)
    np.testing.assert_allclose(
        place.mean(axis=0), [sampling.forward, 0.0], atol=4 * sampling.sway_position / np.sqrt(200)
    )
    np.testing.assert_allclose(place.std(axis=0), sampling.sway_position, rtol=4 / np.sqrt(400))


def test_a_given_route_is_followed_to_its_end():
    """Oracle: distance from a polyline, in NumPy."""
    scene = Scene("hall", "test", np.empty((0, 7)), np.empty((0, 5)), (0.0, 0.0, 10.0, 10.0))
    route = np.array([[1.0, 1.0], [6.0, 1.0], [6.0, 7.0]])
    path = record_camera_path(scene, 0, CameraPathSampling(frames_per_path=20), TINY, None, route)
    assert path is not None
    np.testing.assert_allclose(in_world(path.poses, path.goals[:, :1])[:, 0], np.tile(route[-1], (20, 1)), atol=1e-4)
    x, y = path.poses[:, 0], path.poses[:, 1]
    apart = np.minimum(np.hypot(y - 1, np.maximum(x - 6, 0)), np.hypot(x - 6, np.minimum(y - 1, 0)))
    assert apart.max() < 6 * CameraPathSampling().lateral_spread
    along = np.maximum(x, 6 * (y > 1.6)) + np.maximum(y - 1, 0) * (y > 1.6)
    assert along[-1] > along[0] + 6 and along[-1] <= 1 + 5 + 6


def test_a_scene_without_room_to_walk_gives_nothing():
    slab = np.array([[2.0, 2.0, 0.5, 2.0, 2.0, 0.5, 0.0]])
    scene = Scene("full", "test", slab, np.empty((0, 5)), (0.0, 0.0, 4.0, 4.0))
    assert record_camera_path(scene, 0, SAMPLING, TINY, None) is None


def test_impossible_requests_are_refused():
    with pytest.raises(InputError, match="cannot cover"):
        generate_training_frames(2, families=FAMILIES)
    with pytest.raises(InputError, match="ballroom"):
        tiny_frames(1, families=("ballroom",))
    with pytest.raises(InputError, match="at least one frame"):
        CameraPathSampling(frames_per_path=0)
    with pytest.raises(InputError, match="last_frame"):
        CameraPathSampling(max_route=2.0)
