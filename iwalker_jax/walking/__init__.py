"""The robot that walks on a footstep plan: roll-outs of one robot or many, on MJX or on C MuJoCo."""

from iwalker_jax.walking.commands import Motion, make_walk
from iwalker_jax.walking.setup import Disturbances, Sensors, default_walker, sample_conditions

__all__ = ["Disturbances", "Motion", "Sensors", "default_walker", "make_walk", "sample_conditions"]
