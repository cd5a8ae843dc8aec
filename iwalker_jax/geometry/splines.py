"""Cubic Hermite paths through waypoints, and re-sampling of polylines by arc length."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.geometry.norms import safe_norm


def smooth_step(share: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """The cubic from 0 at 0 to 1 at 1 that starts and ends level."""
    return share * share * (3.0 - 2.0 * share)


def hermite_basis(n_knots: int, n_samples: int) -> np.ndarray:
    """Matrix (n_samples, n_knots) that maps knots to a uniformly sampled cubic Hermite spline.

    Tangents are finite differences (central inside, one-sided at the ends) in the knot parameter, so the spline is a
    fixed linear map of its knots and can be applied, differentiated and batched as one matrix product.
    """
    tangents = np.zeros((n_knots, n_knots))
    tangents[0, :2] = [-1.0, 1.0]
    tangents[-1, -2:] = [-1.0, 1.0]
    for k in range(1, n_knots - 1):
        tangents[k, k - 1], tangents[k, k + 1] = -0.5, 0.5
    parameter = np.linspace(0.0, n_knots - 1, n_samples)
    segment = np.minimum(parameter.astype(int), n_knots - 2)
    t = (parameter - segment)[:, None]
    knots = np.eye(n_knots)
    return (
        (2 * t**3 - 3 * t**2 + 1) * knots[segment]
        + (t**3 - 2 * t**2 + t) * tangents[segment]
        + (3 * t**2 - 2 * t**3) * knots[segment + 1]
        + (t**3 - t**2) * tangents[segment + 1]
    )


def hermite_path(knots: Float[Array, "*batch k 2"], n_samples: int) -> Float[Array, "*batch n 2"]:
    """Points [m] of the cubic Hermite spline through the knots, uniform in the knot parameter; ends included."""
    basis = jnp.asarray(hermite_basis(knots.shape[-2], n_samples), knots.dtype)
    return basis @ knots


def arc_length(path: Float[Array, "n 2"]) -> Float[Array, " n"]:
    """Cumulative length [m] along a polyline, starting at zero."""
    steps = safe_norm(jnp.diff(path, axis=0))
    return jnp.concatenate([jnp.zeros_like(steps[:1]), jnp.cumsum(steps)])


def interpolate_along(
    lengths: Float[Array, " n"], values: Float[Array, "n d"], distances: Float[Array, " m"]
) -> Float[Array, "m d"]:
    """Values at given distances of a quantity known at the (non-decreasing) lengths; its end values beyond the ends.

    Cubic Hermite pieces with finite-difference slopes: linear pieces would put a kink into the gradient wherever a
    distance passes a length, which for an almost even path is everywhere at once.
    """
    after = jnp.clip(jnp.searchsorted(lengths, distances, side="right", method="scan_unrolled"), 1, len(lengths) - 1)
    before = after - 1
    slopes = _slopes(lengths, values)
    gap = lengths[after] - lengths[before]
    # A repeated point makes a zero-length piece: take its first end, with a zero (not NaN) gradient.
    t = jnp.clip(_ratio(distances - lengths[before], gap), 0.0, 1.0)[:, None]
    gap = gap[:, None]
    return (
        (2 * t**3 - 3 * t**2 + 1) * values[before]
        + (t**3 - 2 * t**2 + t) * gap * slopes[before]
        + (3 * t**2 - 2 * t**3) * values[after]
        + (t**3 - t**2) * gap * slopes[after]
    )


def _slopes(lengths: Float[Array, " n"], values: Float[Array, "n d"]) -> Float[Array, "n d"]:
    """Derivatives by central differences, one-sided at the ends; zero where the length does not grow."""
    return _ratio(_neighbour_differences(values), _neighbour_differences(lengths)[:, None])


def _neighbour_differences(values: Float[Array, " n *d"]) -> Float[Array, " n *d"]:
    """Next minus previous value along the first axis; at the ends, of the end and its only neighbour."""
    return jnp.concatenate([values[1:2] - values[:1], values[2:] - values[:-2], values[-1:] - values[-2:-1]])


def _ratio(numerator: Float[Array, "*#n"], denominator: Float[Array, "*#n"]) -> Float[Array, "*n"]:
    positive = denominator > 0
    return jnp.where(positive, numerator / jnp.where(positive, denominator, 1.0), 0.0)


def resample_by_arc_length(path: Float[Array, "n 2"], n_samples: int) -> Float[Array, "m 2"]:
    """The same path with evenly spaced points [m]; ends included."""
    lengths = arc_length(path)
    return interpolate_along(lengths, path, jnp.linspace(0.0, 1.0, n_samples, dtype=path.dtype) * lengths[-1])


def path_tangents(path: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """Unit tangents of a path by central differences; (1, 0) where the path stands still."""
    difference = _neighbour_differences(path)
    length = jnp.sqrt(jnp.sum(difference**2, axis=-1, keepdims=True) + 1e-12)
    forward = jnp.zeros_like(difference).at[:, 0].set(1.0)
    moving = length > 1e-5
    return jnp.where(moving, difference / length, jax.lax.stop_gradient(forward))
