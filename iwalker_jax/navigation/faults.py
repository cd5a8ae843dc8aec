"""What can go wrong in an episode: a blind or frozen camera, lost odometry, an obstacle that is moved."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.scenes import BURIED, SceneArrays

_NEVER = (np.inf, np.inf)


class Faults(NamedTuple):
    """Times [s] from and until which something fails; batch axes first.

    Attributes:
        blind: (2,) the camera gives no returns; frozen: (2,) it repeats its last image.
        odometry: (2,) visual odometry gives no poses.
        box: (7,) a box [cx, cy, cz, hx, hy, hz, yaw] that stands in the scene while `present`: (2,).
    """

    blind: Float[Array, "*batch 2"]
    frozen: Float[Array, "*batch 2"]
    odometry: Float[Array, "*batch 2"]
    box: Float[Array, "*batch 7"]
    present: Float[Array, "*batch 2"]


def make_faults(
    blind: tuple[float, float] = _NEVER,
    frozen: tuple[float, float] = _NEVER,
    odometry: tuple[float, float] = _NEVER,
    box: tuple[float, ...] = (0.0, 0.0, BURIED, 0.1, 0.1, 0.1, 0.0),
    present: tuple[float, float] = _NEVER,
) -> Faults:
    """Faults of one episode; none by default.

    Raises:
        InputError: for a span that ends before it begins, or a box of no size.
    """
    spans = {"blind": blind, "frozen": frozen, "odometry": odometry, "present": present}
    for name, span in spans.items():
        if len(span) != 2 or not span[0] <= span[1]:
            raise InputError(f"Faults.{name} is {span}; give two times [s], the earlier one first.")
    if len(box) != 7 or not all(size > 0 for size in box[3:6]):
        raise InputError("Faults.box needs seven numbers: centre, half sizes above 0 [m] and yaw [rad].")
    arrays = {name: jnp.asarray(span, float) for name, span in spans.items()}
    return Faults(box=jnp.asarray(box, float), **arrays)


def within(span: Float[Array, "2"], time: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether a time [s] lies in a span."""
    return (time >= span[0]) & (time < span[1])


def obstacles_at(faults: Faults, scene: SceneArrays, time: Float[Array, ""]) -> SceneArrays:
    """The scene as it is at a time [s], with the box that comes and goes."""
    buried = faults.box.at[2].set(BURIED)
    box = jnp.where(within(faults.present, time), faults.box, buried)
    return scene._replace(boxes=jnp.concatenate([scene.boxes, box[None].astype(scene.boxes.dtype)]))
