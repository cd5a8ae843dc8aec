"""Is the camera to be trusted? A blind or frozen one must stop the robot before its memory is out of date."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Bool, Float, Int

from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class HealthParameters:
    """When a camera counts as failed.

    Attributes:
        min_valid: share of pixels with a return below which a frame is blind.
        max_bad_frames: blind or identical frames in a row at which the robot stops.
        moving_speed: [m/s] above which two frames cannot be identical.
    """

    min_valid: float = 0.05
    max_bad_frames: int = 3
    moving_speed: float = 0.02

    def __post_init__(self) -> None:
        if not 0 <= self.min_valid < 1 or self.max_bad_frames < 1 or self.moving_speed < 0:
            raise InputError("HealthParameters needs min_valid in [0, 1), max_bad_frames >= 1 and moving_speed >= 0.")


class CameraHealth(NamedTuple):
    """Memory of the check.

    Attributes:
        last: (h, w) the last frame [m].
        bad_frames: () int32, blind or frozen ones in a row.
        failed: () bool; lasts until a good frame that differs from the last one.
    """

    last: Float[Array, "h w"]
    bad_frames: Int[Array, ""]
    failed: Bool[Array, ""]


def healthy_camera(shape: tuple[int, int], dtype: DTypeLike) -> CameraHealth:
    """Before the first frame."""
    return CameraHealth(jnp.zeros(shape, dtype), jnp.zeros((), jnp.int32), jnp.asarray(False))


def check_camera(
    parameters: HealthParameters, health: CameraHealth, depth: Float[Array, "h w"], speed: Float[Array, ""]
) -> CameraHealth:
    """Health after a frame [m], taken at a speed [m/s] of the robot as it believes."""
    blind = jnp.mean((depth > 0) & jnp.isfinite(depth)) < parameters.min_valid
    same = jnp.all(depth == health.last)
    # A standing robot with a perfect camera may well see the same image twice.
    bad = blind | (same & (speed > parameters.moving_speed)) | (same & health.failed)
    count = jnp.where(bad, health.bad_frames + 1, 0)
    return CameraHealth(depth, count, count >= parameters.max_bad_frames)
