"""What the camera saw, on its way to the planner: an image and where it was taken arrive some frames later, together.

A robot's camera, its driver and the networks take time. Until then the robot walks on by its last plan; what arrives
is put on the map where the robot believed to be when the image was taken, not where it believes to be now.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Sighting(NamedTuple):
    """One image and what the robot knew of itself when it was taken.

    Attributes:
        depth: (h, w) [m], 0 = no return.
        mount: (5,) as in `CameraMount`, as the robot believed.
        base: (3,) believed pose of the base frame in the world.
        speed: () [m/s] of the robot, as it believed.
        taken: () bool; false for what stands in until the first image arrives.
    """

    depth: Float[Array, "h w"]
    mount: Float[Array, "5"]
    base: Float[Array, "3"]
    speed: Float[Array, ""]
    taken: Bool[Array, ""]


def start_sightings(
    latency: int, shape: tuple[int, int], mount: Float[Array, "5"], base: Float[Array, "3"]
) -> tuple[Sighting, ...]:
    """What is on its way before the first frame: nothing, in as many places as an image is late in frames.

    Args:
        latency: frames.
        shape: (h, w) of the images.
        mount, base: of the robot at its start.
    """
    still = jnp.zeros((), base.dtype)
    return (Sighting(jnp.zeros(shape, base.dtype), mount, base, still, jnp.asarray(False)),) * latency


def deliver(underway: tuple[Sighting, ...], taken: Sighting) -> tuple[Sighting, tuple[Sighting, ...]]:
    """The sighting that arrives as a new one is taken, and those then on their way, oldest first."""
    arrived, *rest = (*underway, taken)
    return arrived, tuple(rest)
