"""Whole floors of hundreds and thousands of boxes: seen, measured and routed as exactly as single rooms."""

import dataclasses

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from bruce_model import crouch_qpos
from iwalker_jax.evaluation.episodes import FilmSettings
from iwalker_jax.evaluation.episodes.film import film_model
from iwalker_jax.geometry.host import polyline_length
from iwalker_jax.navigation.body_volume import body_clearance_at
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.robot import load_robot_model
from iwalker_jax.scenes.grid_distance import distance_up_to, scene_grid
from iwalker_jax.scenes.imported.user_scene import convert_user_scene
from iwalker_jax.scenes.mjcf import load_mujoco_scene, mujoco_ray_depth
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.scene import LARGEST, SCENE_CAPACITIES, SMALL, Scene, common_capacity, stack_scenes
from iwalker_jax.tasks.reachability import check_task
from iwalker_jax.tasks.routes import comfortable_route, single_precision
from iwalker_jax.tasks.task import Task
from tests.scenes.office_floor import DEPTH, WIDTH, office_floor
from tests.scenes.test_user_scene import mesh_of
from tests.tasks.free_space import clearance_map, connected

CAMERA = Intrinsics(40, 24, 20.0, 20.0, 19.5, 11.5)


@pytest.fixture(scope="module")
def floor() -> Scene:
    return office_floor(500)


def test_arrays_are_as_small_as_the_scene_allows(floor):
    """By hand: the classes' own numbers; a stack is as large as its largest scene; wide rooms need a wide grid."""
    assert floor.capacity == SCENE_CAPACITIES[1] and office_floor(600).arrays().boxes.shape == (2048, 7)
    small = dataclasses.replace(floor, boxes=floor.boxes[-100:], bounds=(0.0, 0.0, 16.0, 16.0))
    assert small.arrays().boxes.shape == (SMALL.boxes, 7) and scene_grid(small.arrays()).shape == (160, 160)
    wide = dataclasses.replace(small, bounds=floor.bounds)
    assert wide.capacity == SCENE_CAPACITIES[1] and scene_grid(wide.arrays()).shape == (512, 512)
    assert stack_scenes([small, floor]).boxes.shape == (2, 512, 7)
    assert stack_scenes([small], common_capacity([small, floor])).boxes.shape == (1, 512, 7)
    assert LARGEST.extent >= 50


def test_rays_meet_what_mujoco_meets(floor):
    """Oracle: C MuJoCo's rays, from a corridor, a room, and close to furniture."""
    model = load_mujoco_scene(floor)
    render = jax.jit(lambda scene, pose: render_depth(scene, CAMERA, *pose))
    for pose in ((2.0, 8.5, 0.1), (22.0, 17.0, 2.0), (41.0, 13.0, -1.0)):
        rotation, position = world_camera_pose(jnp.asarray(pose), CameraMount().as_array())
        seen = np.asarray(render(floor.arrays(), (rotation, position)))
        exact = mujoco_ray_depth(*model, CAMERA, np.asarray(rotation), np.asarray(position))
        assert np.mean(np.abs(seen - exact) < 1e-3) > 0.995


def test_the_body_keeps_its_distance_to_all_of_many_boxes(floor, bruce_mujoco, bruce_volume):
    """Oracle: the clearance in the same scene cut down to what is within two metres, which is a small scene."""
    robot = load_robot_model(bruce_mujoco)
    clearance = jax.jit(lambda scene, qpos: body_clearance_at(robot, bruce_volume, scene, qpos))
    for x, y in ((2.0, 8.5), (20.3, 6.4), (30.0, 13.0)):
        qpos = crouch_qpos()
        qpos[:2] = x, y
        reach = np.hypot(floor.boxes[:, 3], floor.boxes[:, 4])
        near = np.hypot(floor.boxes[:, 0] - x, floor.boxes[:, 1] - y) - reach < 2
        few = dataclasses.replace(floor, boxes=floor.boxes[near], bounds=(x - 2, y - 2, x + 2, y + 2))
        exact = float(clearance(few.arrays(), jnp.asarray(qpos, float)))
        assert float(clearance(floor.arrays(), jnp.asarray(qpos, float))) == pytest.approx(exact, abs=1e-5)


def test_distances_on_the_grid_are_exact_up_to_the_limit(floor):
    """Oracle: SciPy's distance transform of the floor drawn at 2.5 cm."""
    arrays = single_precision(floor)
    grid = scene_grid(arrays)
    distance = np.asarray(jax.jit(lambda scene: distance_up_to(scene, grid.centres(), 0.45))(arrays))
    cells = round(WIDTH / 0.1), round(DEPTH / 0.1)
    fine = clearance_map(floor)[2::4, 2::4]
    free = fine > 0
    errors = np.abs(np.minimum(distance[: cells[0], : cells[1]], 0.45) - np.minimum(fine, 0.45))
    assert errors[free].max() < 0.06


def test_routes_lead_through_the_whole_floor(floor):
    """Oracle: SciPy's regions of the floor drawn at 2.5 cm; the way is longer than straight."""
    start, goal = np.array([1.0, 8.5]), np.array([43.0, 17.5])
    assert connected(floor, clearance_map(floor), [start, goal], 0.2)
    task = Task("t", floor, (*start, 0.0), goal[None])
    check_task(task)
    route = comfortable_route(single_precision(floor), start, goal)
    assert route is not None
    assert np.linalg.norm(goal - start) < polyline_length(route) < 65


def test_a_film_shows_a_scene_of_thousands():
    """Property: MuJoCo loads the robot with every box; the renderer's list of geoms has room for them."""
    scene = office_floor(3000)
    model = film_model(scene, FilmSettings().cut)
    assert sum(model.geom(k).name.startswith("box") for k in range(model.ngeom)) == 3000
    visible = mujoco.MjvScene(model, maxgeom=10_000)
    mujoco.mjv_updateScene(
        model, mujoco.MjData(model), mujoco.MjvOption(), None, mujoco.MjvCamera(), mujoco.mjtCatBit.mjCAT_ALL, visible
    )
    assert visible.ngeom >= 3000


def test_a_mesh_of_the_floor_is_the_floor(tmp_path, floor):
    """Oracle: the boxes that the mesh was made of."""
    mesh_of(floor).export(tmp_path / "floor.stl")
    user = convert_user_scene(tmp_path / "floor.stl")
    assert (user.exact, user.merged) == (len(floor.boxes), 0)
    assert "45.0 x 27.0 m and 2.6 m high with z up" in user.describe()
    mine = user.scene.boxes[np.lexsort(user.scene.boxes[:, :2].T)]
    theirs = floor.boxes[np.lexsort(floor.boxes[:, :2].T)]
    np.testing.assert_allclose(mine[:, :3], theirs[:, :3], atol=1e-4)
    np.testing.assert_allclose(mine[:, 3] * mine[:, 4], theirs[:, 3] * theirs[:, 4], rtol=1e-3)
