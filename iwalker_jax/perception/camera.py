"""Pinhole depth camera: intrinsics, mount, pixel rays and back-projection into the robot's ground frame."""

import math
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from iwalker_jax.checks import require_numbers, require_plain_numbers, require_range
from iwalker_jax.errors import InputError


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics of an undistorted depth image.

    Attributes:
        width, height: [px] image size.
        fx, fy: [px] focal lengths.
        cx, cy: [px] principal point; the centre of the first pixel is (0, 0).
    """

    width: int = 160
    height: int = 90
    fx: float = 80.0
    fy: float = 80.0
    cx: float = 79.5
    cy: float = 44.5

    def __post_init__(self) -> None:
        require_numbers(self)
        values = (self.fx, self.fy, self.cx, self.cy)
        if self.width < 2 or self.height < 2:
            raise InputError(f"Image size must be at least 2 x 2 px, got {self.width} x {self.height}.")
        if not all(math.isfinite(v) for v in values) or not (0 < self.fx <= 1e6 and 0 < self.fy <= 1e6):
            raise InputError(f"Focal lengths must be positive and at most 1e6 px, got fx={self.fx}, fy={self.fy}.")
        if not (-self.width < self.cx < 2 * self.width and -self.height < self.cy < 2 * self.height):
            raise InputError(
                f"The principal point ({self.cx}, {self.cy}) px lies far outside the {self.width} x {self.height} "
                "image; check that the intrinsics belong to this resolution."
            )
        require_plain_numbers(self)

    def rays(self) -> Float[Array, "height width 3"]:
        """Ray through each pixel in the camera's optical frame (x right, y down, z forward), scaled to z = 1."""
        u = (jnp.arange(self.width) - self.cx) / self.fx
        v = (jnp.arange(self.height) - self.cy) / self.fy
        uu, vv = jnp.meshgrid(u, v)
        return jnp.stack([uu, vv, jnp.ones_like(uu)], axis=-1)


def strided(intrinsics: Intrinsics, stride: int) -> Intrinsics:
    """Intrinsics of every `stride`-th pixel of every `stride`-th row, `image[::stride, ::stride]`."""
    return Intrinsics(
        width=-(-intrinsics.width // stride),
        height=-(-intrinsics.height // stride),
        fx=intrinsics.fx / stride,
        fy=intrinsics.fy / stride,
        cx=intrinsics.cx / stride,
        cy=intrinsics.cy / stride,
    )


@dataclass(frozen=True)
class CameraMount:
    """Where the camera sits on the robot, relative to the gravity-aligned `base` frame on the floor.

    Attributes:
        height: [m] above the floor.
        pitch: [rad] positive looks down.
        roll: [rad] positive turns the image's right side down.
        forward: [m] ahead of the base origin.
        left: [m] to the left of the base origin.
    """

    height: float = 0.58
    pitch: float = 0.26
    roll: float = 0.0
    forward: float = 0.028
    left: float = 0.0

    def __post_init__(self) -> None:
        require_numbers(self)
        require_range(self, "height", 0.01, 10.0, "m")
        require_range(self, "pitch", -math.pi / 2, math.pi / 2, "rad")
        require_range(self, "roll", -math.pi, math.pi, "rad")
        require_range(self, "forward", -10.0, 10.0, "m")
        require_range(self, "left", -10.0, 10.0, "m")

    def as_array(self) -> Float[Array, " 5"]:
        """[height, pitch, roll, forward, left], the array form that jitted functions take."""
        return jnp.asarray([self.height, self.pitch, self.roll, self.forward, self.left], jnp.float32)


def camera_pose(mount: Float[Array, " 5"]) -> tuple[Float[Array, "3 3"], Float[Array, " 3"]]:
    """Rotation R_base_camera (optical frame to base frame) and camera position p_base [m] of a mount array.

    Args:
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
    """
    height, pitch, roll, forward, left = mount[0], mount[1], mount[2], mount[3], mount[4]
    sp, cp, sr, cr = jnp.sin(pitch), jnp.cos(pitch), jnp.sin(roll), jnp.cos(roll)
    zero, one = jnp.zeros_like(sp), jnp.ones_like(sp)
    # Columns are the optical axes (right, down, forward) of an unrolled camera, then the roll about the optical axis.
    R_base_level = jnp.stack([jnp.stack([zero, -sp, cp]), jnp.stack([-one, zero, zero]), jnp.stack([zero, -cp, -sp])])
    R_level_camera = jnp.stack([jnp.stack([cr, -sr, zero]), jnp.stack([sr, cr, zero]), jnp.stack([zero, zero, one])])
    return R_base_level @ R_level_camera, jnp.stack([forward, left, height])


def backproject(
    depth: Float[Array | np.ndarray, "height width"], intrinsics: Intrinsics, mount: Float[Array, " 5"]
) -> Float[Array, "height width 3"]:
    """Points [m] in the base frame of a z-depth image [m]; invalid pixels (0) give the camera's centre.

    Args:
        depth: z-depth along the optical axis [m]; 0 means no return.
        intrinsics: of this image size.
        mount: [height, pitch, roll, forward, left] as in `CameraMount`.
    """
    R_base_camera, p_base_camera = camera_pose(mount)
    offsets = offsets_from_camera(depth, intrinsics, R_base_camera)
    return jnp.stack([offset + place for offset, place in zip(offsets, p_base_camera)], axis=-1)


def offsets_from_camera(
    depth: Float[Array | np.ndarray, "height width"], intrinsics: Intrinsics, R_base_camera: Float[Array, "3 3"]
) -> tuple[Float[Array, "height width"], Float[Array, "height width"], Float[Array, "height width"]]:
    """(x, y, z) [m] from the camera to the point of each pixel along the base frame's axes, one array an axis.

    Args:
        depth: z-depth along the optical axis [m]; 0 means no return and gives 0.
        intrinsics: of this image size.
        R_base_camera: from the optical frame to the base frame.
    """
    u = ((jnp.arange(intrinsics.width) - intrinsics.cx) / intrinsics.fx).astype(depth.dtype)
    v = ((jnp.arange(intrinsics.height) - intrinsics.cy) / intrinsics.fy).astype(depth.dtype)[:, None]
    # Written out axis by axis, XLA fuses it into its consumers; as a matrix product it takes ten times as long.
    x, y, z = (depth * (row[0] * u + row[1] * v + row[2]) for row in R_base_camera)
    return x, y, z
