"""The robot on MJX: a checked model, its rigid-body terms, one step of its physics, its leg kinematics."""

from iwalker_jax.robot.contact.solver import (
    ContactSettings,
)
from iwalker_jax.robot.dynamics import (
    SmoothStages,
    smooth_stages,
)
from iwalker_jax.robot.engine import (
    body_poses,
)
from iwalker_jax.robot.leg_kinematics import (
    FootMotion,
    LegKinematics,
    foot_jacobian,
    foot_motion,
    load_leg_kinematics,
)
from iwalker_jax.robot.mjx_step import (
    complete_step_by_mjx,
)
from iwalker_jax.robot.model import (
    RobotModel,
    compile_model,
    load_robot_model,
)
from iwalker_jax.robot.physics import (
    PhysicsInfo,
    PhysicsState,
    complete_step,
    initial_state,
    physics_step,
)
from iwalker_jax.robot.placement import (
    Placement,
    place_robot,
)
from iwalker_jax.robot.rigid_body import (
    RigidBodyTerms,
    rigid_body_terms,
    terms_from_data,
)
from iwalker_jax.robot.structure import (
    FEET,
    contact_point_names,
    site_index,
)
from iwalker_jax.robot.variation import (
    vary,
    vary_mujoco,
)

__all__ = [
    "FEET",
    "ContactSettings",
    "FootMotion",
    "LegKinematics",
    "PhysicsInfo",
    "PhysicsState",
    "Placement",
    "RigidBodyTerms",
    "RobotModel",
    "SmoothStages",
    "body_poses",
    "compile_model",
    "complete_step",
    "complete_step_by_mjx",
    "contact_point_names",
    "foot_jacobian",
    "foot_motion",
    "initial_state",
    "load_leg_kinematics",
    "load_robot_model",
    "physics_step",
    "place_robot",
    "rigid_body_terms",
    "site_index",
    "smooth_stages",
    "terms_from_data",
    "vary",
    "vary_mujoco",
]
