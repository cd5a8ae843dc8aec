"""The unicycle MPC: which path can be tracked."""

from iwalker_jax.optimization.unicycle.model import (
    UnicycleMethod,
    UnicycleParameters,
    UnicyclePlan,
    initial_state_from_reference,
    tracking_cost,
    unicycle_rollout,
)
from iwalker_jax.optimization.unicycle.mpc import solve_unicycle

__all__ = [
    "UnicycleMethod",
    "UnicycleParameters",
    "UnicyclePlan",
    "initial_state_from_reference",
    "solve_unicycle",
    "tracking_cost",
    "unicycle_rollout",
]
