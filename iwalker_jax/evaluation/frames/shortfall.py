"""What a plan is charged that does not serve its goal, so that plans compare at equal reach."""

import math
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.frames.metrics import PlanMetrics


@dataclass(frozen=True)
class ShortfallCharge:
    """Added to each metric of a plan that touches something or falls short of what its goal asks.

    The paper's metrics are all lowest for a robot that stands still, and next to lowest for a straight line through
    the walls. A plan that does not serve its goal therefore pays what one footstep gone wrong by 0.1 m costs.

    Attributes:
        feasibility: [1000 m^2] a path that is 0.1 m off its unicycle optimum everywhere: 1000 x 0.1^2 / 3.
        collision: a footstep on a cell of the published map that is full.
        collision_published: the same, of ten step centres.
        stability: one of five waypoint intervals missing: 1000 x variance of (1.25, 1.25, 1.25, 1.25, 0).
        hlip_cost: a footstep 0.1 m off, at the step MPC's weight of 100 / m^2.
    """

    feasibility: float = 10.0 / 3.0
    collision: float = 2.0
    collision_published: float = 20.0
    stability: float = 250.0
    hlip_cost: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"ShortfallCharge.{field.name} is {value}; give 0 (nothing is charged) or more.")


def charged(
    metrics: PlanMetrics, served: Bool[np.ndarray, " n"] | None, charge: ShortfallCharge = ShortfallCharge()
) -> dict[str, Float[np.ndarray, " n"]]:
    """Each metric by its name, one value a frame, with the charge of those that do not serve their goal.

    Args:
        metrics: with a leading frame axis.
        served: None where nobody knows (a recording without ground truth): then nothing is charged.
        charge: of a plan that is not served.
    """
    fell_short = 0.0 if served is None else ~served
    return {name: np.asarray(value) + getattr(charge, name) * fell_short for name, value in metrics._asdict().items()}
