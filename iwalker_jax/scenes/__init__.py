"""The world, which knows no robot: solids, routes among them, rays, depth noise, export to MuJoCo.

Scenes of a user's own files are in `iwalker_jax.scenes.imported`.
"""

from iwalker_jax.scenes.built.demonstration_scenes import DEMONSTRATION_NAMES, DemonstrationScene, demonstration_scene
from iwalker_jax.scenes.built.hard_rooms import HARD_ROOM_NAMES, HardRoom, hard_room, room_is_passable
from iwalker_jax.scenes.built.held_out_scenes import held_out_scene
from iwalker_jax.scenes.built.held_out_sequences import SEQUENCE_NAMES, HeldOutSequence, held_out_sequence
from iwalker_jax.scenes.built.training_scenes import FAMILIES, generate_scene
from iwalker_jax.scenes.depth_noise import DepthNoise, add_depth_noise
from iwalker_jax.scenes.grid_distance import SCENE_RESOLUTION, occupancy, scene_grid
from iwalker_jax.scenes.mjcf import load_mujoco_scene, mujoco_ray_depth, scene_to_mjcf
from iwalker_jax.scenes.ray_casting import render_depth, world_camera_pose
from iwalker_jax.scenes.routes import (
    RouteMap,
    RouteParameters,
    cost_at,
    free_cells,
    route_map,
    shortest_distance,
    straight_line_clearance,
)
from iwalker_jax.scenes.scene import (
    BURIED,
    LARGEST,
    SCENE_CAPACITIES,
    SMALL,
    Scene,
    SceneArrays,
    SceneCapacity,
    common_capacity,
    obstacle_distance,
    stack_scenes,
)

__all__ = [
    "BURIED",
    "DEMONSTRATION_NAMES",
    "FAMILIES",
    "HARD_ROOM_NAMES",
    "LARGEST",
    "SCENE_CAPACITIES",
    "SCENE_RESOLUTION",
    "SEQUENCE_NAMES",
    "SMALL",
    "DemonstrationScene",
    "DepthNoise",
    "HardRoom",
    "HeldOutSequence",
    "RouteMap",
    "RouteParameters",
    "Scene",
    "SceneArrays",
    "SceneCapacity",
    "add_depth_noise",
    "common_capacity",
    "cost_at",
    "demonstration_scene",
    "free_cells",
    "generate_scene",
    "hard_room",
    "held_out_scene",
    "held_out_sequence",
    "load_mujoco_scene",
    "mujoco_ray_depth",
    "obstacle_distance",
    "occupancy",
    "render_depth",
    "room_is_passable",
    "route_map",
    "scene_grid",
    "scene_to_mjcf",
    "shortest_distance",
    "stack_scenes",
    "straight_line_clearance",
    "world_camera_pose",
]
