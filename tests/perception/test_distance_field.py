"""Distance transforms against SciPy's exact one, and the properties that a distance field must have."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt

from iwalker_jax.errors import InputError
from iwalker_jax.perception.distance_field import distance_transform, grid_diagonal, signed_distance_field
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.map_sampling import sample_bilinear

RESOLUTION = 0.05
UNSIGNED = jax.jit(distance_transform, static_argnums=1)
SIGNED = jax.jit(signed_distance_field, static_argnums=1)


def scipy_signed(occupied):
    outside = distance_transform_edt(~occupied) * RESOLUTION - RESOLUTION / 2
    inside = distance_transform_edt(occupied) * RESOLUTION - RESOLUTION / 2
    return np.where(occupied, -inside, outside)


def random_map(shape, density, seed=0):
    return np.random.default_rng(seed).random(shape) < density


def single(shape, cell):
    occupied = np.zeros(shape, bool)
    occupied[cell] = True
    return occupied


def walls(shape):
    """A room with a frame, two walls with doors and a column."""
    occupied = np.zeros(shape, bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[shape[0] // 3, : shape[1] // 2] = True
    occupied[: shape[0] // 2, 3 * shape[1] // 4] = True
    occupied[2 * shape[0] // 3 : 2 * shape[0] // 3 + 3, 10:14] = True
    return occupied


def diagonal(shape):
    return np.eye(*shape, dtype=bool)


SHAPE = (67, 93)
MAPS = {
    "half": random_map(SHAPE, 0.5),
    "tenth": random_map(SHAPE, 0.1),
    "sparse": random_map(SHAPE, 0.001, seed=5),
    "dense": random_map(SHAPE, 0.95),
    "one hole": ~single(SHAPE, (3, 88)),
    "first cell": single(SHAPE, (0, 0)),
    "last cell": single(SHAPE, (66, 92)),
    "middle cell": single(SHAPE, (30, 41)),
    "walls": walls(SHAPE),
    "diagonal": diagonal(SHAPE),
    "full column": np.arange(SHAPE[1])[None, :] * np.ones((SHAPE[0], 1)) == 17,
    "full row": np.arange(SHAPE[0])[:, None] * np.ones((1, SHAPE[1])) == 60,
    "half plane": np.arange(SHAPE[1])[None, :] * np.ones((SHAPE[0], 1)) > 50,
}


@pytest.mark.parametrize("occupied", MAPS.values(), ids=MAPS.keys())
def test_equals_scipy(occupied):
    """Oracle: scipy.ndimage.distance_transform_edt, both sides."""
    expected = distance_transform_edt(~occupied) * RESOLUTION
    np.testing.assert_allclose(UNSIGNED(jnp.asarray(occupied), RESOLUTION), expected, atol=1e-5)
    np.testing.assert_allclose(SIGNED(jnp.asarray(occupied), RESOLUTION), scipy_signed(occupied), atol=1e-5)


@pytest.mark.parametrize("shape", [(2, 2), (5, 300), (300, 5), (160, 160), (512, 512), (130, 512)])
def test_any_shape_equals_scipy(shape):
    """Oracle: scipy.ndimage.distance_transform_edt on random, sparse and walled maps of each shape."""
    for occupied in (random_map(shape, 0.3), random_map(shape, 0.0005) | single(shape, (1, 1)), walls(shape)):
        if occupied.all():
            continue
        np.testing.assert_allclose(SIGNED(jnp.asarray(occupied), RESOLUTION), scipy_signed(occupied), atol=1e-5)


@pytest.mark.parametrize("shape", [(67, 93), (2, 2), (512, 512)])
def test_maps_of_one_class_give_the_diagonal(shape):
    """Oracle: the documented constant."""
    length = np.hypot(*shape) * RESOLUTION
    assert grid_diagonal(shape, RESOLUTION) == pytest.approx(length)
    empty, full = jnp.zeros(shape, bool), jnp.ones(shape, bool)
    np.testing.assert_allclose(UNSIGNED(empty, RESOLUTION), length, rtol=1e-6)
    np.testing.assert_allclose(SIGNED(empty, RESOLUTION), length, rtol=1e-6)
    np.testing.assert_allclose(SIGNED(full, RESOLUTION), -length, rtol=1e-6)
    np.testing.assert_array_equal(UNSIGNED(full, RESOLUTION), 0)


@pytest.mark.parametrize("occupied", MAPS.values(), ids=MAPS.keys())
def test_the_signed_field_is_one_lipschitz(occupied):
    """Oracle: the definition, for neighbouring cells and random pairs of cells, across the border as well."""
    field = np.asarray(SIGNED(jnp.asarray(occupied), RESOLUTION), float)
    rows, columns = field.shape
    for a, b in ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, -1)):
        here = field[: rows - a, max(0, -b) : columns - max(0, b)]
        there = field[a:, max(0, b) : columns + min(0, b)]
        assert np.max(np.abs(here - there)) <= RESOLUTION * np.hypot(a, b) + 1e-6
    rng = np.random.default_rng(0)
    first, second = rng.integers(0, SHAPE, (2, 200_000, 2))
    difference = np.abs(field[tuple(first.T)] - field[tuple(second.T)])
    assert np.all(difference <= RESOLUTION * np.linalg.norm(first - second, axis=1) + 1e-6)


def test_samples_between_cells_change_by_at_most_the_way_along_an_axis():
    """Oracle: the definition, on bilinear samples of a half-full map."""
    grid = GridSpec(x_min=0.0, y_min=0.0, resolution=RESOLUTION, rows=SHAPE[0], columns=SHAPE[1])
    field = SIGNED(jnp.asarray(MAPS["half"]), RESOLUTION)
    rng = np.random.default_rng(0)
    points = jnp.asarray(rng.uniform((0, 0), (grid.x_max, grid.y_max), (20_000, 2)), jnp.float32)
    for axis in range(2):
        step = jnp.asarray(np.eye(2)[axis] * 0.01, jnp.float32)
        change = sample_bilinear(field, grid, points + step) - sample_bilinear(field, grid, points)
        assert np.max(np.abs(change)) <= 0.01 + 1e-5


def test_the_zero_level_lies_on_the_faces_between_cells():
    """Oracle: a half plane, whose distance is known everywhere."""
    occupied = jnp.asarray(MAPS["half plane"])
    face = 51 * RESOLUTION
    centres = (np.arange(SHAPE[1]) + 0.5) * RESOLUTION
    np.testing.assert_allclose(SIGNED(occupied, RESOLUTION), np.broadcast_to(face - centres, SHAPE), atol=1e-5)


def test_transposing_and_mirroring_the_map_does_the_same_to_the_field():
    """Oracle: symmetry of the plane."""
    occupied = jnp.asarray(MAPS["tenth"])
    field = SIGNED(occupied, RESOLUTION)
    np.testing.assert_allclose(SIGNED(occupied.T, RESOLUTION), field.T, atol=1e-6)
    np.testing.assert_allclose(SIGNED(occupied[::-1], RESOLUTION), field[::-1], atol=1e-6)
    np.testing.assert_allclose(SIGNED(~occupied, RESOLUTION), -field, atol=1e-6)


def test_a_batch_equals_a_loop_and_nested_batches_work():
    """Oracle: the maps one by one."""
    maps = jnp.asarray(np.stack([MAPS["half"], MAPS["sparse"], MAPS["first cell"], MAPS["walls"]]))
    single_maps = jnp.stack([SIGNED(m, RESOLUTION) for m in maps])
    batch = jax.jit(jax.vmap(lambda m: signed_distance_field(m, RESOLUTION)))
    np.testing.assert_allclose(batch(maps), single_maps, atol=1e-6)
    nested = jax.jit(jax.vmap(jax.vmap(lambda m: signed_distance_field(m, RESOLUTION))))
    np.testing.assert_allclose(nested(maps.reshape(2, 2, *SHAPE)), single_maps.reshape(2, 2, *SHAPE), atol=1e-6)


def test_maps_too_large_for_exact_integers_are_refused():
    """Oracle: the error sentence, and SciPy just within the limit along one axis."""
    with pytest.raises(InputError, match="16000"):
        jax.eval_shape(lambda m: signed_distance_field(m, RESOLUTION), jax.ShapeDtypeStruct((8001, 8000), bool))
    occupied = single((15_990, 3), (15_989, 2))
    np.testing.assert_allclose(SIGNED(jnp.asarray(occupied), RESOLUTION), scipy_signed(occupied), rtol=1e-6)


def test_gradients_flow_past_the_field():
    """Oracle: by hand; the field is constant with respect to what made the map, and does not stop other gradients."""

    def loss(height, scale):
        return jnp.sum(scale * signed_distance_field(height > 0.5, RESOLUTION))

    heights = jnp.asarray(np.random.default_rng(0).random(SHAPE), jnp.float32)
    gradients = jax.jit(jax.grad(loss, argnums=(0, 1)))(heights, 2.0)
    np.testing.assert_array_equal(gradients[0], 0)
    np.testing.assert_allclose(gradients[1], jnp.sum(SIGNED(heights > 0.5, RESOLUTION)), rtol=1e-4)
    mapped = jax.vmap(jax.grad(loss, argnums=1), in_axes=(0, None))(jnp.stack([heights, heights.max() - heights]), 2.0)
    np.testing.assert_allclose(mapped[0], gradients[1], rtol=1e-5)


@pytest.mark.parametrize(
    ("occupied", "resolution"),
    [(np.ones((4, 5), int), 0.1), (np.ones(5, bool), 0.1), (np.ones((0, 5), bool), 0.1), ("map", 0.1)]
    + [(np.ones((4, 5), bool), side) for side in (0.0, -0.1, np.nan, np.inf, "fine", [0.1, 0.1])],
)
def test_what_is_no_map_and_no_resolution_is_refused(occupied, resolution, unchecked_types):
    with pytest.raises(InputError, match=r"^The (map|resolution) "):
        signed_distance_field(occupied, resolution)
