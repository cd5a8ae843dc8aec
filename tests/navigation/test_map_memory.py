"""The remembered map. Oracle: obstacles of known place in the world, seen from a robot that moves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.memory import (
    MapMemoryParameters,
    empty_memory,
    memory_cells,
    update_memory,
    window_origin,
)
from iwalker_jax.perception import FrameCells
from iwalker_jax.perception.grid import DEFAULT_GRID

PARAMETERS = MapMemoryParameters(resolution=DEFAULT_GRID.resolution, cells=80)
CENTRES = np.asarray(DEFAULT_GRID.centres())
NOTHING = FrameCells(*[jnp.zeros(DEFAULT_GRID.shape, bool)] * 3)
update = jax.jit(update_memory, static_argnums=0)


def frame(base: np.ndarray, obstacle: np.ndarray, radius: float = 0.2, reach: float = 2.0):
    """What a robot at `base` sees of a round obstacle in the world: occupied, and free in a wedge ahead of it."""
    cos, sin = np.cos(base[2]), np.sin(base[2])
    world = CENTRES @ np.array([[cos, sin], [-sin, cos]]) + base[:2]
    occupied = np.linalg.norm(world - obstacle, axis=-1) < radius
    wedge = (CENTRES[..., 0] > 0.3) & (np.linalg.norm(CENTRES, axis=-1) < reach)
    wedge &= np.abs(CENTRES[..., 1]) < CENTRES[..., 0]
    return cells(occupied & wedge, wedge & ~occupied)


def cells(occupied: np.ndarray, free: np.ndarray) -> FrameCells:
    """A frame that saw every free cell's floor."""
    return FrameCells(jnp.asarray(occupied), jnp.asarray(free), jnp.asarray(free))


def occupied_points(memory) -> np.ndarray:
    """World positions of the occupied cells."""
    occupied, _ = memory_cells(PARAMETERS, memory)
    return (np.asarray(PARAMETERS.grid.centres()) + np.asarray(window_origin(PARAMETERS, memory)))[np.asarray(occupied)]


def rounded(memory) -> set[tuple]:
    """World positions of the occupied cells, to compare."""
    return {tuple(point) for point in np.round(occupied_points(memory), 3)}


def with_a_disc(ahead: float):
    """The memory of a disc of 10 cm that was seen three times so far ahead, and its `rounded` cells."""
    memory = empty_memory(PARAMETERS, jnp.zeros(2))
    for _ in range(3):
        memory = update(PARAMETERS, memory, jnp.zeros(3), frame(np.zeros(3), np.array([ahead, 0.0]), radius=0.1))
    return memory, rounded(memory)


def test_an_obstacle_is_remembered_in_its_place_while_the_robot_walks_past():
    """Oracle: the obstacle's disc in the world, within the two roundings to cells."""
    obstacle = np.array([1.3, 0.35])
    memory = empty_memory(PARAMETERS, jnp.asarray([0.0, 0.0]))
    for x in np.arange(0.0, 1.6, 0.06):
        base = np.array([x, 0.0, 0.3 * np.sin(3 * x)])
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, obstacle))
    points = occupied_points(memory)
    distance = np.linalg.norm(points - obstacle, axis=1)
    assert len(points) > 0.7 * np.pi * 0.2**2 / PARAMETERS.resolution**2
    assert distance.max() < 0.2 + 2 * PARAMETERS.resolution


def test_what_is_seen_to_be_free_again_is_forgotten():
    base, obstacle = np.zeros(3), np.array([1.0, 0.0])
    memory = empty_memory(PARAMETERS, jnp.zeros(2))
    for _ in range(30):
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, obstacle))
    assert len(occupied_points(memory)) > 0
    gone = np.array([50.0, 50.0])
    for _ in range(8):
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, gone))
    assert len(occupied_points(memory)) == 0


def test_unseen_cells_stay_unknown_but_for_those_under_the_body():
    memory = update(PARAMETERS, empty_memory(PARAMETERS, jnp.zeros(2)), jnp.zeros(3), NOTHING)
    occupied, unknown = memory_cells(PARAMETERS, memory)
    elsewhere = np.linalg.norm(np.asarray(PARAMETERS.grid.centres()), axis=-1) > PARAMETERS.body_radius
    assert not occupied.any() and np.asarray(unknown)[elsewhere].all()


def test_a_single_frame_of_noise_is_not_believed_once_the_next_shows_free_floor():
    """Oracle: counting; a frame that adds 1.0 and one that takes off 0.7 leave less than 0.9, three and one do not."""
    base, obstacle, gone = np.zeros(3), np.array([1.0, 0.0]), np.array([50.0, 50.0])
    for frames, believed in ((1, False), (3, True)):
        memory = empty_memory(PARAMETERS, jnp.zeros(2))
        for _ in range(frames):
            memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, obstacle))
        assert len(occupied_points(memory)) > 0
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, gone))
        assert (len(occupied_points(memory)) > 0) == believed


def test_a_single_frame_of_noise_that_is_not_looked_at_again_fades():
    """Oracle: log(0.9) / log(1 - 0.001) = 105.3 frames until evidence of 1.0 falls below the threshold."""
    base = np.zeros(3)
    seen = frame(base, np.array([1.0, 0.0]))
    memory = update(PARAMETERS, empty_memory(PARAMETERS, jnp.zeros(2)), jnp.asarray(base), seen)
    lasts = int(np.log(PARAMETERS.threshold) / np.log1p(-PARAMETERS.decay))
    for _ in range(lasts):
        memory = update(PARAMETERS, memory, jnp.asarray(base), NOTHING)
    assert len(occupied_points(memory)) > 0
    assert len(occupied_points(update(PARAMETERS, memory, jnp.asarray(base), NOTHING))) == 0


def test_the_window_follows_the_robot_by_whole_cells():
    """Oracle: the evidence of a cell keeps its world place exactly, however the window moves."""
    base, obstacle = np.array([0.0, 0.0, 0.4]), np.array([0.9, 0.4])
    memory = empty_memory(PARAMETERS, jnp.zeros(2))
    for _ in range(3):
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, obstacle))
    before = {tuple(np.round(p / PARAMETERS.resolution, 1)) for p in occupied_points(memory)}
    for x in np.linspace(0, -0.5, 12):
        memory = update(PARAMETERS, memory, jnp.asarray([x, 0.37 * x, 0.0]), NOTHING)
    after = {tuple(np.round(p / PARAMETERS.resolution, 1)) for p in occupied_points(memory)}
    assert before and before == after


def test_what_stands_beside_the_robot_is_remembered_after_it_left_the_view():
    """Oracle: posts of known place, passed with 0.09 to 0.27 m to spare; nothing nearer than 0.6 m is seen."""
    posts = np.array([[1.2, 0.17], [1.5, -0.3], [1.8, 0.35], [2.1, -0.22]])
    memory = empty_memory(PARAMETERS, jnp.zeros(2))
    for x in np.arange(0.0, 2.4, 0.02):
        base = np.array([x, 0.0, 0.0])
        seen = [frame(base, post, radius=0.08) for post in posts]
        occupied = np.any([one.occupied for one in seen], axis=0) & (CENTRES[..., 0] > 0.6)
        free = np.all([one.known_free for one in seen], axis=0) & (CENTRES[..., 0] > 0.6)
        memory = update(PARAMETERS, memory, jnp.asarray(base), cells(occupied, free))
    for _ in range(45):
        memory = update(PARAMETERS, memory, jnp.asarray([2.4, 0.0, 0.0]), NOTHING)
    points = occupied_points(memory)
    for post in posts:
        share = np.sum(np.linalg.norm(points - post, axis=1) < 0.08) / (np.pi * 0.08**2 / PARAMETERS.resolution**2)
        assert share > 0.7, post


def test_the_body_makes_unknown_floor_free_and_nothing_else():
    """Oracle: by construction; a disc of the body's radius, of which a part was seen to be occupied."""
    memory, before = with_a_disc(0.45)
    for _ in range(60):
        memory = update(PARAMETERS, memory, jnp.asarray([0.35, 0.0, 0.0]), NOTHING)
    assert before and before == rounded(memory)
    _, unknown = memory_cells(PARAMETERS, memory)
    places = np.asarray(PARAMETERS.grid.centres()) + np.asarray(window_origin(PARAMETERS, memory))
    under = np.linalg.norm(places - [0.35, 0.0], axis=-1) < PARAMETERS.body_radius - 0.01
    assert not np.asarray(unknown)[under].any()


def test_a_robot_that_believes_to_have_jumped_starts_afresh():
    base, obstacle = np.zeros(3), np.array([1.0, 0.0])
    memory = empty_memory(PARAMETERS, jnp.zeros(2))
    for _ in range(3):
        memory = update(PARAMETERS, memory, jnp.asarray(base), frame(base, obstacle))
    memory = update(PARAMETERS, memory, jnp.asarray([3.0, 0.0, 0.0]), NOTHING)
    assert not memory_cells(PARAMETERS, memory)[0].any()


def test_useless_parameters_are_refused():
    with pytest.raises(InputError, match="multiple of 8"):
        MapMemoryParameters(cells=81)


def test_a_threshold_that_has_left_the_view_at_the_lower_edge_stays():
    """Oracle: by construction; floor that is presumed free frees what nobody saw, and no obstacle that was seen."""
    memory, before = with_a_disc(0.9)
    wedge = jnp.asarray(np.linalg.norm(CENTRES, axis=-1) < 1.2)
    presumed = FrameCells(jnp.zeros_like(wedge), wedge, jnp.zeros_like(wedge))
    for _ in range(60):
        memory = update(PARAMETERS, memory, jnp.zeros(3), presumed)
    assert before and before == rounded(memory)
    occupied, unknown = memory_cells(PARAMETERS, memory)
    places = np.asarray(PARAMETERS.grid.centres())
    ahead = (np.linalg.norm(places, axis=-1) < 1.1) & (places[..., 0] > DEFAULT_GRID.x_min + PARAMETERS.resolution)
    assert not np.asarray(unknown)[ahead & ~np.asarray(occupied)].any()
