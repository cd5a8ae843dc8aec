"""The models that losses and metrics share beside the planner's own: unicycle, body."""

from dataclasses import dataclass

from iwalker_jax.checks import require_range
from iwalker_jax.optimization import UnicycleParameters
from iwalker_jax.perception import TraversalParameters


@dataclass(frozen=True)
class PlannerModels:
    """The models that the two lower-level optimisations and the costs are made of.

    Attributes:
        unicycle: the path MPC.
        traversal: cost of walking through the map.
        safety_margin: [m] clearance beyond the body radius that the collision terms ask for.
        blind_walking: extra cost per metre of a path (not of the cost-to-go) through space that was not seen.
    """

    unicycle: UnicycleParameters = UnicycleParameters()
    traversal: TraversalParameters = TraversalParameters()
    safety_margin: float = 0.10
    blind_walking: float = 4.5

    def __post_init__(self) -> None:
        require_range(self, "safety_margin", 0.0, 2.0, "m")
        require_range(self, "blind_walking", 0.0, 1e6, "per metre")
