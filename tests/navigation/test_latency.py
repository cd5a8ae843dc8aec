"""Images that arrive late, to a robot that slides ahead at one speed. Oracles: indices of frames, and where it was."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.errors import InputError
from iwalker_jax.navigation import closed_loop
from iwalker_jax.navigation.closed_loop import run_episode, start_episode
from iwalker_jax.navigation.faults import make_faults
from iwalker_jax.navigation.navigators import LoopParameters, make_navigator
from iwalker_jax.navigation.sightings import Sighting, deliver, start_sightings
from iwalker_jax.planning.ipath import IPathConfig
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.robot.rigid_body import rigid_body_terms
from iwalker_jax.scenes.scene import Scene
from iwalker_jax.tasks.task import Task, stack_tasks
from iwalker_jax.walking.rollout import walk_tick
from iwalker_jax.walking.setup import Disturbances, sample_conditions

FRAMES, APPEARS = 20, 5
SPEED = 0.15  # [m/s]
WALL = Scene("wall", "test", np.array([[4.0, 0.0, 0.6, 0.1, 2.0, 0.6, 0.0]]), np.zeros((0, 5)), (-1, -2, 5, 2))
TASK = Task("ahead", WALL, (0.0, 0.0, 0.0), np.array([[2.5, 0.0]]))


def slide(walker, conditions, plan, walk):
    """In place of `walk_tick`: straight ahead, without legs."""
    physics = walk.physics._replace(
        qpos=walk.physics.qpos.at[0].add(SPEED * walker.controller.time_step),
        time=walk.physics.time + walker.controller.time_step,
    )
    _, sample = jax.eval_shape(partial(walk_tick, walker), conditions, plan, walk)
    sample = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), sample)
    com = rigid_body_terms(walker.robot, physics.qpos, physics.qvel).com
    return walk._replace(physics=physics), sample._replace(com=com)


@pytest.fixture(scope="module", params=[0, 1, 2])
def watched(request):
    """The latency, and two episodes of a robot that knows its true state: a box appears before the second one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed_loop, "walk_tick", slide)
        return request.param, episodes(request.param)


def episodes(latency: int):
    """Records of an episode without and one with the box."""
    planner = Planner(PlannerConfig(ipath=IPathConfig(trunk_width=4, hidden=16)), nnx.Rngs(0))
    loop = LoopParameters(latency_frames=latency)
    navigator = make_navigator("classical", planner, sensors="none", depth_noise=False, loop=loop)
    conditions = jax.tree.map(
        lambda leaf: jnp.stack([leaf[0]] * 2), sample_conditions(navigator.walker.robot, Disturbances(), 1, 0)
    )
    begins = (APPEARS - 0.5) * navigator.frame_time
    box = make_faults(box=(1.21, 0.1, 0.4, 0.1, 0.3, 0.4, 0.0), present=(begins, 1e6))
    faults = jax.tree.map(lambda *leaves: jnp.stack(leaves), make_faults(), box)
    tasks = stack_tasks([TASK, TASK])
    state = jax.jit(jax.vmap(partial(start_episode, navigator)))(tasks, conditions)
    many = jax.jit(jax.vmap(lambda *each: run_episode(navigator, *each, FRAMES, True)[1]))
    return jax.tree.map(np.asarray, many(tasks, conditions, faults, state))


def first_difference(leaf: np.ndarray) -> int:
    """The first frame in which the two episodes differ."""
    return int(np.flatnonzero((leaf[0] != leaf[1]).reshape(FRAMES, -1).any(axis=1))[0])


def test_image_and_map_change_as_many_frames_after_an_obstacle_appears_as_images_are_late(watched):
    """The path changes once the map is sure, not before."""
    latency, record = watched
    assert first_difference(record.depth) == APPEARS + latency
    assert first_difference(record.cells) == APPEARS + latency
    assert APPEARS + latency < first_difference(record.path) < APPEARS + latency + 10


def test_the_pose_is_the_one_at_which_the_image_was_taken(watched):
    """Oracle: speed times time; the pose of another frame is 10 mm off."""
    latency, record = watched
    seconds = np.maximum(np.arange(FRAMES) - latency, 0) * 0.066
    travelled = record.believed[..., 0] - record.believed[:, :1, 0]
    np.testing.assert_allclose(travelled, np.broadcast_to(SPEED * seconds, (2, FRAMES)), atol=1e-3)


def test_nobody_sets_out_before_the_first_image_has_arrived(watched):
    """Oracle: the frame's number; nothing else holds this robot up."""
    latency, record = watched
    assert record.stopped[:, :latency].all()
    assert not record.stopped[:, latency].any()


def test_sightings_arrive_in_their_order():
    """Oracle: counting; what stands in before the first one is marked."""
    underway = start_sightings(2, (2, 3), jnp.zeros(5), jnp.ones(3))
    seen = []
    for k in range(4):
        taken = Sighting(jnp.full((2, 3), float(k)), jnp.zeros(5), jnp.zeros(3), jnp.zeros(()), jnp.asarray(True))
        arrived, underway = deliver(underway, taken)
        seen.append((bool(arrived.taken), float(arrived.depth[0, 0])))
    assert seen == [(False, 0.0), (False, 0.0), (True, 0.0), (True, 1.0)]
    assert [float(each.depth[0, 0]) for each in underway] == [2.0, 3.0]


def test_images_from_the_future_are_refused():
    with pytest.raises(InputError, match="latency of 0 or more"):
        LoopParameters(latency_frames=-1)
