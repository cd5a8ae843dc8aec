"""Map sampling against SciPy's interpolation and finite differences, inside, on the border and far outside."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import BSpline, RegularGridInterpolator

from iwalker_jax.errors import InputError
from iwalker_jax.perception.grid import GridSpec
from iwalker_jax.perception.map_sampling import sample_bilinear, sample_smooth

GRID = GridSpec(x_min=-0.3, y_min=-1.0, resolution=0.1, rows=9, columns=13)
SAMPLERS = pytest.mark.parametrize("sample", [sample_bilinear, sample_smooth])
OUTSIDE = pytest.mark.parametrize("outside", ["extend", "clamp"])


def random_field(seed=0):
    return np.random.default_rng(seed).normal(size=GRID.shape)


def random_points(n, margin, seed=1):
    """Points up to `margin` [m] beyond the map (negative: inside), kept off the lines where bilinear has kinks."""
    rng = np.random.default_rng(seed)
    low = np.array([GRID.x_min - margin, GRID.y_min - margin])
    high = np.array([GRID.x_max + margin, GRID.y_max + margin])
    u = (rng.uniform(low, high, (n, 2)) - [GRID.x_min, GRID.y_min]) / GRID.resolution - 0.5
    u = np.floor(u) + 0.1 + 0.8 * (u - np.floor(u))
    return (u + 0.5) * GRID.resolution + [GRID.x_min, GRID.y_min]


def test_bilinear_equals_scipy_inside(x64):
    """Oracle: scipy.interpolate.RegularGridInterpolator."""
    field, points = random_field(), random_points(200, -0.05)
    centres = np.asarray(GRID.centres())
    oracle = RegularGridInterpolator((centres[:, 0, 0], centres[0, :, 1]), field)(points)
    np.testing.assert_allclose(sample_bilinear(jnp.asarray(field), GRID, jnp.asarray(points)), oracle, atol=1e-12)


def test_smooth_equals_scipys_quadratic_spline_everywhere(x64):
    """Oracle: scipy.interpolate.BSpline basis functions summed over a map padded with its border values."""
    field, points = random_field(), random_points(200, 0.5)
    pad = 10
    padded = np.pad(field, pad, mode="edge")
    basis = BSpline.basis_element([-1.5, -0.5, 0.5, 1.5], extrapolate=False)
    u = np.asarray(GRID.cell_coordinates(jnp.asarray(points)))
    row = np.nan_to_num(basis(u[:, 0, None] - np.arange(-pad, GRID.rows + pad)))
    column = np.nan_to_num(basis(u[:, 1, None] - np.arange(-pad, GRID.columns + pad)))
    oracle = np.einsum("ni,ij,nj->n", row, padded, column)
    value = sample_smooth(jnp.asarray(field), GRID, jnp.asarray(points), outside="clamp")
    np.testing.assert_allclose(value, oracle, atol=1e-12)


@SAMPLERS
def test_linear_fields_are_exact(sample, x64):
    """Oracle: the plane itself, away from the border's repeated cells."""
    points = jnp.asarray(random_points(100, -0.1))
    normal = jnp.asarray([0.7, -1.3])
    np.testing.assert_allclose(sample(GRID.centres() @ normal, GRID, points), points @ normal, atol=1e-12)


@SAMPLERS
@OUTSIDE
def test_gradients_agree_with_finite_differences(sample, outside, x64):
    """Oracle: central differences, for points and field, inside and outside; forward equals reverse."""
    field, points = jnp.asarray(random_field()), jnp.asarray(random_points(40, 0.4))
    weights = jnp.asarray(np.random.default_rng(2).normal(size=40))

    def loss(field, points):
        return jnp.sum(weights * sample(field, GRID, points, outside=outside) ** 2)

    reverse = jax.grad(loss, argnums=(0, 1))(field, points)
    forward = jax.jacfwd(loss, argnums=(0, 1))(field, points)
    step = 1e-6
    for argument, value in enumerate((field, points)):
        arguments = [field, points]
        numerical = np.zeros(value.shape)
        evaluate = jax.jit(loss)
        for index in np.ndindex(value.shape):
            arguments[argument] = value.at[index].add(step)
            above = evaluate(*arguments)
            arguments[argument] = value.at[index].add(-step)
            numerical[index] = (above - evaluate(*arguments)) / (2 * step)
        np.testing.assert_allclose(reverse[argument], forward[argument], rtol=1e-10, atol=1e-10)
        scale = np.abs(numerical).max()
        np.testing.assert_allclose(reverse[argument], numerical, rtol=1e-5, atol=1e-5 * scale * 1e-2)


@OUTSIDE
def test_smooth_has_no_jumps_in_its_gradient(outside, x64):
    """Oracle: the gradient along a dense line across the map and both borders changes in proportion to the step."""
    field = jnp.asarray(random_field())
    gradient = jax.jit(jax.vmap(jax.grad(lambda p: sample_smooth(field, GRID, p, outside=outside))))
    largest = []
    for n in (4001, 8001):
        line = jnp.linspace(jnp.asarray([-1.0, -1.7]), jnp.asarray([1.4, 1.1]), n)
        largest.append(np.abs(np.diff(gradient(line), axis=0)).max())
    assert largest[1] < 0.6 * largest[0]


@SAMPLERS
def test_far_outside_values_and_gradients_are_defined(sample):
    """Oracle: by hand: the border value, plus the distance to the outermost cell centres when extended."""
    field = jnp.asarray(random_field(), jnp.float32)
    corner_x, corner_y = GRID.x_max - 0.05, GRID.y_max - 0.05
    points = jnp.asarray([[corner_x + 30.0, corner_y + 40.0], [100.0, 0.05], [-1e6, 1e6]])
    clamped = sample(field, GRID, points, outside="clamp")
    extended = sample(field, GRID, points, outside="extend")
    smoothing = 0.0 if sample is sample_bilinear else 0.5 * GRID.resolution
    np.testing.assert_allclose(clamped[0], field[-1, -1], rtol=1e-5)
    np.testing.assert_allclose(extended[:2] - clamped[:2], np.array([50.0, 100.0 - corner_x]) - smoothing, rtol=1e-5)
    for outside, normal in (("clamp", [0.0, 0.0]), ("extend", [0.6, 0.8])):
        slope = jax.vmap(jax.grad(lambda p, o=outside: sample(field, GRID, p, outside=o)))(points)
        assert jnp.all(jnp.isfinite(slope))
        np.testing.assert_allclose(slope[0], normal, atol=1e-5)


@SAMPLERS
@OUTSIDE
def test_gradients_are_finite_on_cell_centres_edges_and_corners(sample, outside):
    """Oracle: finiteness and the bound by the steepest neighbouring cells, at every half cell across the border."""
    field = jnp.asarray(random_field(), jnp.float32)
    half_cells = np.stack(np.meshgrid(np.arange(-4, 24), np.arange(-4, 32), indexing="ij"), axis=-1) / 2
    points = jnp.asarray((half_cells.reshape(-1, 2) + 0.5) * GRID.resolution + [GRID.x_min, GRID.y_min], jnp.float32)
    slope = jax.vmap(jax.grad(lambda p: sample(field, GRID, p, outside=outside)))(points)
    steepest = max(np.abs(np.diff(field, axis=a)).max() for a in (0, 1)) / GRID.resolution
    assert np.all(np.abs(slope) <= steepest + 1 + 1e-3)


def test_nan_points_give_nan_and_leave_others_alone():
    """Oracle: by construction."""
    field = jnp.asarray(random_field(), jnp.float32)
    points = jnp.asarray([[jnp.nan, 0.0], [0.1, 0.1]])
    for sample in (sample_bilinear, sample_smooth):
        values = sample(field, GRID, points)
        assert jnp.isnan(values[0])
        assert jnp.isfinite(values[1])


def test_wrong_shapes_and_modes_are_refused(unchecked_types):
    """Oracle: the error sentence."""
    with pytest.raises(InputError, match="shape"):
        sample_bilinear(jnp.zeros((3, 3)), GRID, jnp.zeros(2))
    with pytest.raises(InputError, match="outside"):
        sample_smooth(jnp.zeros(GRID.shape), GRID, jnp.zeros(2), outside="wrap")
