"""One height parts floor from obstacles: for the map, for ground truth, for collisions, and for converted scenes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.control import GaitParameters
from iwalker_jax.geometry import BODY
from iwalker_jax.navigation.body_volume import BodyVolume, body_clearance
from iwalker_jax.perception.camera import CameraMount, Intrinsics
from iwalker_jax.perception.collision_map import occupancy_map
from iwalker_jax.scenes.imported.user_scene import convert_user_scene
from iwalker_jax.scenes.scene import Scene, obstacle_distance
from tests.perception.box_scene import render

MOUNT, INTRINSICS = CameraMount(), Intrinsics()
HEIGHTS = [0.005, 0.015, 0.02, 0.03, 0.04, 0.045, 0.05, 0.06, 0.1]
occupancy = jax.jit(occupancy_map, static_argnums=2)


def bar(height: float) -> Scene:
    """A bar 10 cm wide across the way, 0.8 m ahead."""
    box = [0.75, 0.0, height / 2, 0.05, 0.5, height / 2, 0.0]
    return Scene("bar", "test", np.array([box]), np.zeros((0, 5)), (-2, -2, 4, 2))


def test_the_swing_foot_clears_what_counts_as_floor():
    assert GaitParameters().swing_height > BODY.step_over


@pytest.mark.parametrize("height", HEIGHTS)
def test_map_truth_and_collision_agree_on_what_is_floor(height):
    """Oracle: the height alone. The body is one sphere that stands in the bar."""
    floor = height <= BODY.step_over
    scene = bar(height).arrays()
    seen = occupancy(render(INTRINSICS, MOUNT, [(0.7, 0.8, -0.5, 0.5, 0.0, height)]), MOUNT.as_array(), INTRINSICS)
    assert bool(seen.any()) != floor
    assert (float(obstacle_distance(scene, jnp.asarray([0.75, 0.0]))) > 1) == floor
    foot = BodyVolume(jnp.zeros(1, jnp.int32), jnp.zeros((1, 3)), jnp.full(1, 0.01))
    touched = body_clearance(foot, jnp.asarray([[0.75, 0.0, 0.01]]), jnp.eye(3)[None], scene)
    assert (float(touched) > 1) == floor


def test_a_converted_scene_leaves_out_what_is_floor_and_says_so(tmp_path):
    """Oracle: the heights of the model's boxes."""
    boxes = "".join(
        f'<geom type="box" pos="{n} 0 {height / 2}" size="0.1 0.1 {height / 2}"/>' for n, height in enumerate(HEIGHTS)
    )
    file = tmp_path / "bars.xml"
    file.write_text(f"<mujoco><worldbody><geom type='plane' size='9 9 1'/>{boxes}</worldbody></mujoco>")
    user = convert_user_scene(file)
    tops = sorted(user.scene.boxes[:, 2] + user.scene.boxes[:, 5])
    np.testing.assert_allclose(tops, [height for height in HEIGHTS if height > BODY.step_over], atol=1e-6)
    assert user.low == sum(height <= BODY.step_over for height in HEIGHTS)
    assert "3 that end at 2.5 cm or lower count as floor and were left out" in user.describe()
