"""A cheap walk by sight for training: true scenes with their fields, footsteps without whole-body physics."""

from iwalker_jax.surrogate.true_fields import FieldParameters, TrueFields, make_fields, sample_fields
from iwalker_jax.surrogate.walk import (
    SurrogateOutcome,
    SurrogateParameters,
    SurrogateState,
    Visit,
    decide,
    follow,
    see,
    start_surrogate,
    surrogate_step,
    way_to_go,
)

__all__ = [
    "FieldParameters",
    "SurrogateOutcome",
    "SurrogateParameters",
    "SurrogateState",
    "TrueFields",
    "Visit",
    "decide",
    "follow",
    "make_fields",
    "sample_fields",
    "see",
    "start_surrogate",
    "surrogate_step",
    "way_to_go",
]
