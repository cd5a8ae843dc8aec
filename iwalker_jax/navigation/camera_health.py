"""Is the camera to be trusted? A blind or frozen one must stop the robot before its memory is out of date."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int


@dataclass(frozen=True)
class HealthParameters:
    """When a camera counts as failed.

    Attributes:
        least_valid: share of pixels with a return below which a frame is blind.
        patience: such frames, or identical ones, in a row before the robot stops.
        moving: [m/s] speed above which two frames cannot be identical.
    """

    least_valid: float = 0.05
    patience: int = 3
    moving: float = 0.02


class CameraHealth(NamedTuple):
    """Memory of the check.

    Attributes:
        last: (h, w) the last frame [m].
        bad: () int32, blind or frozen frames in a row.
        failed: () bool; lasts until a good frame that differs from the last one.
    """

    last: Float[Array, "h w"]
    bad: Int[Array, ""]
    failed: Bool[Array, ""]


def healthy_camera(shape: tuple[int, int], dtype: jnp.dtype) -> CameraHealth:
    """Before the first frame."""
    return CameraHealth(jnp.zeros(shape, dtype), jnp.zeros((), jnp.int32), jnp.asarray(False))


def check_camera(
    rules: HealthParameters, health: CameraHealth, depth: Float[Array, "h w"], speed: Float[Array, ""]
) -> CameraHealth:
    """Health after a frame [m], taken at a speed [m/s] of the robot as it believes."""
    blind = jnp.mean((depth > 0) & jnp.isfinite(depth)) < rules.least_valid
    same = jnp.all(depth == health.last)
    # A standing robot with a perfect camera may well see the same image twice.
    bad = blind | (same & (speed > rules.moving)) | (same & health.failed)
    count = jnp.where(bad, health.bad + 1, 0)
    return CameraHealth(depth, count, count >= rules.patience)
