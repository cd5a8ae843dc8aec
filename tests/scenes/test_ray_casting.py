"""Depth rendering: against MuJoCo's rays, by hand on simple scenes, and its derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.perception.camera import CameraMount, Intrinsics, backproject
from iwalker_jax.scenes.built.held_out_scenes import held_out_scene
from iwalker_jax.scenes.built.training_scenes import generate_scene
from iwalker_jax.scenes.mjcf import load_mujoco_scene, mujoco_ray_depth
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import Scene, obstacle_distance, stack_scenes

SMALL = Intrinsics(48, 32, 24.0, 24.0, 23.5, 15.5)
render = jax.jit(render_depth, static_argnums=1)


def make_scene(boxes=(), cylinders=(), ceiling=None) -> Scene:
    box_rows = np.asarray(boxes, float).reshape(-1, 7)
    cylinder_rows = np.asarray(cylinders, float).reshape(-1, 5)
    return Scene("t", "t", box_rows, cylinder_rows, (-8.0, -8.0, 8.0, 8.0), ceiling)


def look(x: float, y: float, yaw: float, **mount: float):
    base = jnp.asarray([x, y, yaw], float)
    values = CameraMount(**{"pitch": 0.0, "forward": 0.0, **mount})
    return world_camera_pose(
        base, jnp.asarray([values.height, values.pitch, values.roll, values.forward, values.left], float)
    )


def random_views(scene: Scene, count: int, seed: int):
    """Camera poses anywhere in the bounds (inside obstacles, too), tilted and rolled."""
    rng = np.random.default_rng(seed)
    low, high = np.asarray(scene.bounds[:2]), np.asarray(scene.bounds[2:])
    for _ in range(count):
        x, y = rng.uniform(low, high)
        yield look(
            x,
            y,
            rng.uniform(-3.2, 3.2),
            height=rng.uniform(0.2, 1.2),
            pitch=rng.uniform(-0.5, 0.7),
            roll=rng.normal(0, 0.2),
        )


@pytest.mark.parametrize("family", ["open_office", "factory_hall", "landing", "kitchen", "corridor_doors", "held_out"])
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_depth_equals_mujoco_rays(family, precision):
    """Oracle: mj_multiRay on the same scene exported to MJCF; only silhouette pixels may differ."""
    with jax.enable_x64(precision == "float64"):
        tolerance = 1e-4 if precision == "float32" else 1e-8
        for seed in range(2):
            scene = held_out_scene(seed) if family == "held_out" else generate_scene(family, seed)
            model, data = load_mujoco_scene(scene)
            arrays = scene.arrays()
            for R, p in random_views(scene, 4, seed):
                ours = np.asarray(render(arrays, Intrinsics(), R, p))
                theirs = mujoco_ray_depth(model, data, Intrinsics(), np.asarray(R), np.asarray(p))
                assert (ours > 0).mean() > 0.3
                assert (abs(ours - theirs) > tolerance).mean() < 0.005


def test_known_distances():
    """Oracle: by hand, along the optical axis of a level camera at 1 m (odd image, so one pixel looks straight on)."""
    K = Intrinsics(5, 5, 50.0, 50.0, 2.0, 2.0)
    scene = make_scene(
        boxes=[[3.0, 0.0, 1.0, 0.5, 0.5, 1.0, 0.0], [0.0, 4.0, 1.0, 0.5, 0.5, 1.0, np.pi / 4]],
        cylinders=[[-2.0, 0.0, 1.0, 0.4, 1.0]],
        ceiling=2.5,
    ).arrays()
    for yaw, expected in ((0.0, 2.5), (np.pi / 2, 4.0 - np.sqrt(0.5)), (np.pi, 1.6), (-np.pi / 2, 0.0)):
        depth = render(scene, K, *look(0.0, 0.0, yaw, height=1.0))
        np.testing.assert_allclose(depth[2, 2], expected, atol=2e-5)
    down = render(scene, K, *look(0.0, 0.0, 0.7, height=1.0, pitch=np.pi / 2))
    up = render(scene, K, *look(0.0, 0.0, 0.7, height=1.0, pitch=-np.pi / 2))
    np.testing.assert_allclose(down, 1.0, atol=1e-5)
    np.testing.assert_allclose(up, 1.5, atol=1e-5)


def test_from_inside_and_on_faces():
    """Oracle: by hand; inside solids the far face is seen, and grazing along faces gives finite numbers."""
    K = Intrinsics(5, 5, 50.0, 50.0, 2.0, 2.0)
    scene = make_scene([[0.0, 0.0, 1.0, 2.0, 1.0, 1.0, 0.0]], [[6.0, 0.0, 1.0, 0.8, 1.0]]).arrays()
    np.testing.assert_allclose(render(scene, K, *look(0.5, 0.0, 0.0, height=1.0))[2, 2], 1.5, atol=1e-5)
    np.testing.assert_allclose(render(scene, K, *look(6.3, 0.0, 0.0, height=1.0))[2, 2], 0.5, atol=1e-5)
    for y, height in ((1.0, 1.0), (0.0, 2.0), (1.0, 2.0)):
        depth = render(scene, K, *look(-4.0, y, 0.0, height=height))
        assert np.isfinite(depth).all()
    np.testing.assert_allclose(render(scene, K, *look(-4.0, 1.0 - 1e-3, 0.0, height=1.0))[2, 2], 2.0, atol=1e-4)


@pytest.mark.parametrize("x", [0.0, 0.31, 0.56, 1.21, 2.05])
def test_exactly_vertical_and_level_rays(x):
    """Oracle: MuJoCo's rays and, on the axis, the heights by hand, from above, beside and inside a post and a table."""
    scene = make_scene([[2.0, 0.0, 0.6, 0.3, 0.4, 0.1, 0.0]], [[0.0, 0.0, 0.4, 0.5, 0.4]], ceiling=2.5)
    K = Intrinsics(11, 11, 3.0, 3.0, 5.0, 5.0)
    model, data = load_mujoco_scene(scene)
    down = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    up, level = down @ np.diag([1.0, -1.0, -1.0]), np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for R in (down, up, level):
        for height in (1.0, 0.3):
            position = np.array([x, 0.0, height])
            ours = np.asarray(render(scene.arrays(), K, jnp.asarray(R, float), jnp.asarray(position, float)))
            np.testing.assert_allclose(ours, mujoco_ray_depth(model, data, K, R, position), atol=1e-4)
            if height == 1.0 and R is down:
                top = 0.8 if x < 0.5 else 0.7 if x > 1.7 else 0.0
                np.testing.assert_allclose(ours[5, 5], 1.0 - top, atol=1e-5)


def test_max_depth_cuts_to_zero():
    """Oracle: a longer range shows the same pixels and adds only farther ones."""
    scene = generate_scene("lobby", 3)
    R, p = look(4.0, 0.8, 1.2)
    near = np.asarray(render(scene.arrays(), SMALL, R, p, 3.0))
    far = np.asarray(render(scene.arrays(), SMALL, R, p, 30.0))
    assert 0 < (near == 0).sum() < near.size
    np.testing.assert_array_equal(near, np.where(far <= 3.0, far, 0.0))


def test_points_lie_on_surfaces():
    """Oracle: back-projected pixels above the floor have zero plan-view distance to a scene of upright walls."""
    scene = make_scene(
        [[2.5, 0.3, 1.5, 0.3, 1.8, 1.5, 0.4], [1.0, 2.0, 1.5, 1.0, 0.1, 1.5, -0.3]], [[1.5, -0.8, 1.5, 0.3, 1.5]]
    )
    mount = CameraMount().as_array()
    base = jnp.asarray([-0.7, 0.2, 0.1])
    depth = render(scene.arrays(), SMALL, *world_camera_pose(base, mount))
    points = np.asarray(backproject(depth, SMALL, mount))
    seen = (np.asarray(depth) > 0) & (points[..., 2] > 0.05)
    cos, sin = np.cos(0.1), np.sin(0.1)
    world = points[..., :2] @ np.array([[cos, sin], [-sin, cos]]) + np.asarray(base[:2])
    assert seen.sum() > 300
    np.testing.assert_allclose(obstacle_distance(scene.arrays(), jnp.asarray(world))[seen], 0.0, atol=1e-4)


def test_batches_equal_single_images():
    """Oracle: the same images rendered one at a time."""
    scenes = [generate_scene("storage", 0), generate_scene("slalom", 1), generate_scene("lobby", 2)]
    views = [next(iter(random_views(scene, 1, i))) for i, scene in enumerate(scenes)]
    R, p = jnp.stack([v[0] for v in views]), jnp.stack([v[1] for v in views])
    batch = jax.jit(jax.vmap(lambda s, R, p: render_depth(s, SMALL, R, p)))(stack_scenes(scenes), R, p)
    poses = jax.jit(jax.vmap(lambda R, p: render_depth(scenes[0].arrays(), SMALL, R, p)))(R, p)
    for i, scene in enumerate(scenes):
        np.testing.assert_allclose(batch[i], render(scene.arrays(), SMALL, *views[i]), atol=1e-5)
        np.testing.assert_allclose(poses[i], render(scenes[0].arrays(), SMALL, *views[i]), atol=1e-5)


def test_gradients_equal_finite_differences(x64):
    """Oracle: central differences of pixels away from silhouettes; forward and reverse mode agree on all pixels."""
    tiny = Intrinsics(24, 16, 12.0, 12.0, 11.5, 7.5)

    def image(scene, pose):
        return render_depth(scene, tiny, *world_camera_pose(pose[:3], pose[3:])).ravel()

    fast, jacobian = jax.jit(image), jax.jit(jax.jacfwd(image, argnums=1))
    weighted = jax.jit(jax.grad(lambda pose, scene, weights: jnp.dot(weights, image(scene, pose))))
    weights = jnp.asarray(np.random.default_rng(0).normal(size=tiny.width * tiny.height))
    pose = jnp.asarray([1.0, 1.1, 0.6, 0.58, 0.2, 0.03, 0.075, 0.01])
    step = 1e-6
    for family, seed in (("factory_hall", 0), ("open_office", 1)):
        scene = generate_scene(family, seed).arrays()
        forward = np.asarray(jacobian(scene, pose))
        assert np.isfinite(forward).all()
        shifts = step * jnp.eye(8)
        numeric = np.stack([np.asarray(fast(scene, pose + d) - fast(scene, pose - d)) / (2 * step) for d in shifts], 1)
        smooth = abs(numeric).max(axis=1) < 1e3
        assert smooth.mean() > 0.98
        np.testing.assert_allclose(forward[smooth], numeric[smooth], rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(weighted(pose, scene, weights), forward.T @ np.asarray(weights), rtol=1e-8)


def test_gradient_of_scene_geometry(x64):
    """Oracle: central differences with respect to a box's and a cylinder's own numbers and the ceiling."""
    arrays = make_scene([[3.0, 0.2, 0.6, 0.5, 0.7, 0.6, 0.3]], [[2.0, -0.9, 0.5, 0.3, 0.5]], ceiling=2.4).arrays()
    R, p = look(0.0, 0.0, 0.0, pitch=0.05)

    @jax.jit
    def total(box, cylinder, ceiling):
        scene = arrays._replace(
            boxes=arrays.boxes.at[0].set(box), cylinders=arrays.cylinders.at[0].set(cylinder), ceiling=ceiling
        )
        return render_depth(scene, SMALL, R, p)

    primals = arrays.boxes[0], arrays.cylinders[0], arrays.ceiling
    step = 1e-6
    for argument, jacobian in enumerate(jax.jit(jax.jacfwd(total, argnums=(0, 1, 2)))(*primals)):
        flat = np.atleast_1d(np.asarray(primals[argument]))
        for k in range(flat.size):
            delta = np.zeros_like(flat)
            delta[k] = step
            values = [list(primals), list(primals)]
            for sign, moved in zip((1, -1), values, strict=True):
                moved[argument] = jnp.asarray((flat + sign * delta).reshape(np.shape(primals[argument])))
            numeric = np.asarray(total(*values[0]) - total(*values[1])) / (2 * step)
            ours = np.asarray(jacobian).reshape(*numeric.shape, -1)[..., k]
            smooth = abs(numeric) < 1e3
            assert smooth.mean() > 0.98
            np.testing.assert_allclose(ours[smooth], numeric[smooth], rtol=1e-5, atol=1e-5)


def test_gradients_stay_finite_in_degenerate_poses():
    """Oracle: none but finiteness; rays exactly along axes and faces, cameras inside geoms, single precision."""
    scene = make_scene([[2.0, 0.0, 0.6, 0.3, 0.4, 0.6, 0.0]], [[0.0, 2.0, 0.58, 0.5, 0.58]], ceiling=2.5).arrays()
    K = Intrinsics(11, 11, 3.0, 3.0, 5.0, 5.0)
    gradient = jax.jit(jax.grad(lambda R, p, s: render_depth(s, K, R, p).sum(), argnums=(0, 1, 2)))
    down = jnp.asarray([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    level = jnp.asarray([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    some = 0.0
    for R in (down, level):
        for position in ([2.0, 0.0, 0.6], [1.7, 0.4, 1.2], [0.0, 2.0, 1.16], [0.5, 2.0, 0.58], [0.0, 0.0, 0.58]):
            leaves = jax.tree.leaves(gradient(R, jnp.asarray(position), scene))
            assert all(np.isfinite(leaf).all() for leaf in leaves), position
            some += sum(float(abs(leaf).sum()) for leaf in leaves)
    assert some > 1.0
