"""The models that planner, losses and metrics share: pendulum, unicycle, steps, body."""

from dataclasses import dataclass

from iwalker_jax.optimization import HlipParameters, StepMpcWeights, UnicycleParameters
from iwalker_jax.perception import TraversalParameters
from iwalker_jax.planning.robot_state import StepGeometry


@dataclass(frozen=True)
class PlannerModels:
    """The models that the two lower-level optimisations and the costs are made of.

    Attributes:
        unicycle: the path MPC.
        hlip, step_weights: the step MPC.
        steps: desired foot placement.
        traversal: cost of walking through the map.
        safety_margin: [m] clearance beyond the body radius that the collision terms ask for.
        blind_walking: extra cost per metre of a path (not of the cost-to-go) through space that was not seen.
    """

    unicycle: UnicycleParameters = UnicycleParameters()
    hlip: HlipParameters = HlipParameters()
    step_weights: StepMpcWeights = StepMpcWeights()
    steps: StepGeometry = StepGeometry()
    traversal: TraversalParameters = TraversalParameters()
    safety_margin: float = 0.10
    blind_walking: float = 4.5
