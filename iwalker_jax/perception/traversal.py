"""What a metre of walking costs, from the distance field and from what is unknown."""

from dataclasses import dataclass

import jax.numpy as jnp
from jaxtyping import Array, Float

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.errors import InputError
from iwalker_jax.geometry import BODY, smooth_step


@dataclass(frozen=True)
class TraversalParameters:
    """Cost per metre as a function of clearance; 1 in open, seen space.

    Attributes:
        body_radius: [m] half the body's width at the elbows; nearer than this the body touches.
        comfort: [m] clearance from which a metre costs no more than in the open.
        discomfort: extra cost per metre where the body just fits, growing quadratically below `comfort`.
        contact: extra cost per metre where the body touches; finite, so that a route out of contact always exists.
        contact_ramp: [m] over which the contact cost rises, centred on `body_radius`.
        unknown: extra cost per metre through space that was not seen.
    """

    body_radius: float = BODY.radius
    comfort: float = 0.45
    discomfort: float = 2.0
    contact: float = 30.0
    contact_ramp: float = 0.10
    unknown: float = 0.7

    def __post_init__(self) -> None:
        require_plain_numbers(self)
        if not 0 < self.body_radius < self.comfort or not self.contact_ramp > 0:
            raise InputError("TraversalParameters needs 0 < body_radius < comfort and contact_ramp > 0.")
        if min(self.discomfort, self.contact, self.unknown) < 0:
            raise InputError("Traversal costs must not be negative.")


def traversal_cost(
    clearance: Float[Array, "*shape"], unknown: Float[Array, "*shape"], parameters: TraversalParameters
) -> Float[Array, "*shape"]:
    """Cost per metre at a clearance [m] and a degree of being unknown (0 seen .. 1 unseen); differentiable."""
    tightness = jnp.clip((parameters.comfort - clearance) / (parameters.comfort - parameters.body_radius), 0.0, 1.0)
    touching = jnp.clip((parameters.body_radius - clearance) / parameters.contact_ramp + 0.5, 0.0, 1.0)
    return (
        1.0
        + parameters.discomfort * tightness**2
        + parameters.contact * smooth_step(touching)
        + parameters.unknown * unknown
    )
