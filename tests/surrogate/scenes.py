"""Scenes with true fields for the tests of the surrogate walk."""

import functools

import jax

from iwalker_jax.scenes import SceneArrays, obstacle_distance
from iwalker_jax.surrogate import FieldParameters, SurrogateParameters, SurrogateState, make_fields, start_surrogate

GRIDS = FieldParameters(goals=2)
CALM = SurrogateParameters(
    noise=None,
    sway_height=0.0,
    sway_pitch=0.0,
    sway_roll=0.0,
    sway_yaw=0.0,
    sway_left=0.0,
    mount_error=0.0,
    advance_share=0.0,
    step_forward=0.0,
    step_left=0.0,
    turn_share=0.0,
    step_turn=0.0,
    drift_share=0.0,
    drift_turn=0.0,
)
"""A robot that does what it means to do."""


@functools.cache
def fields():
    """Of three scenes."""
    return make_fields(3, 5, GRIDS)


@functools.cache
def start(seed: int, parameters: SurrogateParameters = CALM) -> SurrogateState:
    made = fields()
    return jax.jit(lambda key: start_surrogate(parameters, GRIDS, made, key))(jax.random.key(seed))


def clearance_at(state: SurrogateState):
    """[m] by the scene itself."""
    return obstacle_distance(scene_of(state.scene), state.true[None, :2])[0]


def scene_of(row) -> SceneArrays:
    """One of the scenes."""
    return jax.tree.map(lambda leaf: leaf[row], fields().scenes)
