"""Scenes that are generated or designed by hand, and what a design is made of: layouts, rooms, furniture."""

from iwalker_jax.scenes.built.demonstration_scenes import DEMONSTRATION_NAMES, DemonstrationScene, demonstration_scene
from iwalker_jax.scenes.built.hard_rooms import HARD_ROOM_NAMES, HardRoom, hard_room, room_is_passable
from iwalker_jax.scenes.built.held_out_scenes import held_out_scene
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES, HeldOutSequence, held_out_sequence
from iwalker_jax.scenes.built.layout import HELD_OUT_STYLE, TRAINING_STYLE, Furniture, Layout, Pose2D, Style
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene

__all__ = [
    "DEMONSTRATION_NAMES",
    "FAMILIES",
    "HARD_ROOM_NAMES",
    "HELD_OUT_STYLE",
    "SEQUENCE_NAMES",
    "TRAINING_STYLE",
    "DemonstrationScene",
    "Furniture",
    "HardRoom",
    "HeldOutSequence",
    "Layout",
    "Pose2D",
    "Style",
    "demonstration_scene",
    "generate_scene",
    "hard_room",
    "held_out_scene",
    "held_out_sequence",
    "room_is_passable",
]
