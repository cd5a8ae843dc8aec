"""Paths drawn off obstacles. Oracles: distances to discs and walls in closed form, central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iwalker_jax.errors import InputError
from iwalker_jax.navigation.path_band import BandParameters, safe_path, way_to_room
from iwalker_jax.perception.distance_field import signed_distance_field
from iwalker_jax.perception.grid import GridSpec

GRID = GridSpec(-4.0, -4.0, 0.05, 160, 160)
CENTRES = np.asarray(GRID.centres())
PARAMETERS = BandParameters()
band = jax.jit(lambda path, esdf: safe_path(PARAMETERS, path, esdf, GRID))
STRAIGHT = jnp.stack([jnp.linspace(0.0, 3.0, 60), jnp.zeros(60)], axis=1)


def disc(x: float, y: float, radius: float) -> np.ndarray:
    return np.linalg.norm(CENTRES - [x, y], axis=-1) < radius


def test_in_the_open_the_path_stays_as_it_is():
    esdf = signed_distance_field(jnp.asarray(disc(0.0, 3.0, 0.2)), 0.05)
    path, cut = band(STRAIGHT, esdf)
    assert not cut
    np.testing.assert_allclose(path[:, 1], 0.0, atol=1e-4)
    np.testing.assert_allclose(path[-1], [3.0, 0.0], atol=1e-3)


def test_a_path_that_grazes_an_obstacle_is_drawn_off_it():
    """Oracle: distance to the disc itself."""
    esdf = signed_distance_field(jnp.asarray(disc(1.5, 0.25, 0.2)), 0.05)
    path, cut = band(STRAIGHT, esdf)
    clearance = np.linalg.norm(np.asarray(path) - [1.5, 0.25], axis=1) - 0.2
    assert not cut
    assert clearance.min() > PARAMETERS.min_clearance
    assert np.linalg.norm(STRAIGHT - np.array([1.5, 0.25]), axis=1).min() - 0.2 < 0.06


def test_a_path_into_a_wall_ends_before_it():
    """Oracle: the wall's place; no point of the path is nearer than the body needs."""
    esdf = signed_distance_field(jnp.asarray(CENTRES[..., 0] > 2.0), 0.05)
    path, _ = band(STRAIGHT, esdf)
    assert float(path[:, 0].max()) < 2.0 - PARAMETERS.min_clearance + 0.03
    assert float(path[-1, 0]) > 1.2


def test_a_robot_that_stands_too_close_can_walk_away_but_not_closer():
    esdf = signed_distance_field(jnp.asarray(CENTRES[..., 0] < -0.1), 0.05)
    away, cut = band(STRAIGHT, esdf)
    assert not cut and float(away[-1, 0]) > 2.9
    closer, _ = band(-STRAIGHT, esdf)
    assert float(closer[:, 0].min()) > -0.01


def test_room_to_turn_lies_straight_off_a_wall_and_in_the_middle_of_a_corridor():
    """Oracle: the wall's place; a corridor of 0.44 m, in which no place has more room than its middle."""
    wall = signed_distance_field(jnp.asarray(CENTRES[..., 0] < -0.2), 0.05)
    for distance in (0.10, 0.20, 0.30):
        offset = way_to_room(PARAMETERS, jnp.asarray([distance - 0.2, 0.0]), wall, GRID)
        expected = max(PARAMETERS.turning_clearance - distance, 0.0)
        np.testing.assert_allclose(offset, [expected, 0.0], atol=0.012)
    grid = GridSpec(-1.0, -1.0, 0.02, 100, 100)
    across = np.asarray(grid.centres())[..., 1]
    corridor = signed_distance_field(jnp.asarray(np.abs(across) > 0.22), 0.02)
    offset = way_to_room(PARAMETERS, jnp.asarray([0.1, 0.06]), corridor, grid)
    np.testing.assert_allclose(offset, [0.0, -0.06], atol=0.03)


def test_room_to_turn_lies_before_a_gap_and_not_beyond_a_pole():
    """Oracle: the places of the walls, a gap of 0.38 m between them, and of a pole 4 cm thick."""
    grid = GridSpec(-1.0, -1.0, 0.02, 100, 100)
    x, y = np.moveaxis(np.asarray(grid.centres()), -1, 0)
    gap = signed_distance_field(jnp.asarray((x > 0) & (np.abs(y) > 0.19)), 0.02)
    out = way_to_room(PARAMETERS, jnp.asarray([0.15, 0.0]), gap, grid)
    assert -0.45 < float(out[0]) < -0.25 and abs(float(out[1])) < 0.15
    pole = signed_distance_field(jnp.asarray(x**2 + y**2 < 0.02**2), 0.02)
    for place in ([0.12, 0.0], [-0.1, 0.08]):
        offset = np.asarray(way_to_room(PARAMETERS, jnp.asarray(place), pole, grid))
        np.testing.assert_allclose(np.linalg.norm(place + offset), PARAMETERS.turning_clearance + 0.02, atol=0.03)
        assert offset @ place > 0.95 * np.linalg.norm(offset) * np.linalg.norm(place)


@pytest.mark.parametrize("width", [0.40, 0.45, 0.60])
@pytest.mark.parametrize("aside", [-0.2, 0.0, 0.07])
def test_a_band_through_a_gap_lies_on_its_middle_line(width, aside):
    """However long the way to it: steps that overshoot the line would leave another side at every length. Oracle: the
    gap's place and width, less what smooth sampling takes off the ridge of the distance field."""
    grid = GridSpec(-2.0, -2.0, 0.025, 160, 160)
    x, y = np.moveaxis(np.asarray(grid.centres()), -1, 0)
    esdf = signed_distance_field(jnp.asarray((np.abs(x - 0.8) < 0.06) & (np.abs(y) > width / 2)), 0.025)
    through = jax.jit(lambda start: safe_path(PARAMETERS, jnp.linspace(start, jnp.asarray([1.6, 0.0]), 60), esdf, grid))
    for begin in np.arange(-0.5, 0.5, 0.07):
        path, cut = through(jnp.asarray([begin, aside], jnp.float32))
        assert not cut
        inside = np.asarray(path)[np.abs(np.asarray(path)[:, 0] - 0.8) < 0.1]
        assert len(inside) > 1
        np.testing.assert_allclose(inside[:, 1], 0.0, atol=0.01)


@pytest.mark.parametrize("width", [0.30, 0.34, 0.36])
def test_a_robot_never_creeps_through_a_gap_that_it_does_not_fit(width):
    """It walks each path to its end and asks again, swaying. Oracle: the place of the gap's mouth and of its corners,
    within half a cell."""
    grid = GridSpec(-2.0, -2.0, 0.025, 160, 160)
    x, y = np.moveaxis(np.asarray(grid.centres()), -1, 0)
    esdf = signed_distance_field(jnp.asarray((np.abs(x - 0.8) < 0.06) & (np.abs(y) > width / 2)), 0.025)
    through = jax.jit(lambda start: safe_path(PARAMETERS, jnp.linspace(start, jnp.asarray([1.6, 0.0]), 60), esdf, grid))
    at = np.zeros(2)
    for k in range(60):
        path, cut = through(jnp.asarray([at[0], at[1] + 0.02 * (-1) ** k], jnp.float32))
        assert cut
        at = np.asarray(path[-1]) * [1.0, 0.0]
    mouth = 0.8 - 0.06
    assert at[0] < mouth - 0.03
    assert np.hypot(mouth - at[0], width / 2) > PARAMETERS.min_clearance - 0.0125


def test_a_path_walled_in_on_all_sides_is_cut():
    """A ring without room for the body around its far end; oracle: the ring's geometry."""
    distance = np.linalg.norm(CENTRES - [2.0, 0.0], axis=-1)
    esdf = signed_distance_field(jnp.asarray((distance > 0.15) & (distance < 0.6)), 0.05)
    _, cut = safe_path(BandParameters(iterations=0), STRAIGHT, esdf, GRID)
    assert cut


def test_gradients_flow_from_map_and_path():
    """Oracle: central differences along a random direction, in double precision."""
    with jax.enable_x64(True):
        esdf = jnp.asarray(np.linalg.norm(CENTRES - [1.5, 0.25], axis=-1) - 0.2, jnp.float64)
        # Uneven and curved, so that no point of the band lies on a kink of the interpolation.
        path = np.stack([3 * np.linspace(0, 1, 60) ** 1.1, 0.05 * np.sin(np.linspace(0, 3, 60))], axis=1)
        path = jnp.asarray(path)

        def cost(path, esdf):
            return jnp.sum(safe_path(PARAMETERS, path, esdf, GRID)[0] ** 2)

        rng = np.random.default_rng(0)
        directions = (jnp.asarray(rng.normal(size=path.shape)), jnp.asarray(rng.normal(size=esdf.shape)))
        for k, along in enumerate(directions):
            arguments = [path, esdf]
            step = 1e-7

            def moved(h, k=k, along=along, arguments=arguments):
                return cost(*(a + h * along if n == k else a for n, a in enumerate(arguments)))

            expected = (moved(step) - moved(-step)) / (2 * step)
            reverse = jnp.sum(jax.grad(cost, argnums=k)(*arguments) * along)
            forward = jax.jvp(moved, (0.0,), (1.0,))[1]
            np.testing.assert_allclose(reverse, expected, rtol=1e-5)
            np.testing.assert_allclose(forward, expected, rtol=1e-5)


def test_useless_parameters_are_refused():
    with pytest.raises(InputError, match="min_clearance < desired_clearance"):
        BandParameters(desired_clearance=0.1, min_clearance=0.2)
