"""Robots that walk: what must be told of one, the model that is made of it, and those that are known by name."""

from iwalker_jax.humanoids.description import Anatomy, RobotDescription, Sole
from iwalker_jax.humanoids.model_building import build_model
from iwalker_jax.humanoids.named import ROBOT_NAMES, load_robot
from iwalker_jax.humanoids.similarity import similar_gait, similar_tasks

__all__ = [
    "ROBOT_NAMES",
    "Anatomy",
    "RobotDescription",
    "Sole",
    "build_model",
    "load_robot",
    "similar_gait",
    "similar_tasks",
]
