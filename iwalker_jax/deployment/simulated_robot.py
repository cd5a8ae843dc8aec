"""A robot to try a policy on: C MuJoCo's physics, and a depth camera in a task's scene."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from bruce_model import load_mujoco
from iwalker_jax.navigation import body_clearance_at, load_body_volume, load_camera, place_at
from iwalker_jax.navigation.depth_camera import start_depth_camera, take_depth
from iwalker_jax.perception import Intrinsics
from iwalker_jax.robot import load_robot_model
from iwalker_jax.scenes import DepthNoise, SceneArrays
from iwalker_jax.tasks import Task, stack_tasks
from iwalker_jax.walking import Disturbances, MujocoRobot, sample_conditions


class MeasuredState(NamedTuple):
    """What the robot's estimator says; NumPy.

    Attributes:
        qpos, qvel: MuJoCo's conventions.
        touching: (2,) bool, right and left foot press on the floor.
    """

    qpos: Float[np.ndarray, " nq"]
    qvel: Float[np.ndarray, " nv"]
    touching: Bool[np.ndarray, "2"]


class SimulatedRobot:
    """One robot in a task's scene, at its start; the estimator tells its true state."""

    def __init__(
        self,
        task: Task,
        intrinsics: Intrinsics = Intrinsics(),
        seed: int = 0,
        noise: DepthNoise | None = DepthNoise(),
    ) -> None:
        """Stand at the start.

        Args:
            task: scene and start.
            intrinsics: of the camera's images.
            seed: of the robot's conditions and its camera's noise.
            noise: of the camera; None for ideal depth.
        """
        model = load_mujoco()
        robot, camera, volume = load_robot_model(model), load_camera(model), load_body_volume(model)
        arrays = stack_tasks([task])
        drawn = place_at(sample_conditions(robot, Disturbances(), 1, seed), arrays.start)
        conditions = jax.tree.map(lambda leaf: leaf[0], drawn)
        scene: SceneArrays = jax.tree.map(lambda leaf: leaf[0], arrays.scene)
        self.time_step = robot.time_step
        self._robot = MujocoRobot(robot, model, conditions)
        self._camera_state = start_depth_camera(camera, conditions.qpos, conditions.key)
        self._take = jax.jit(lambda qpos, state: take_depth(camera, intrinsics, noise, scene, qpos, state))
        self._clearance = jax.jit(lambda qpos: body_clearance_at(robot, volume, scene, qpos))

    def state(self) -> MeasuredState:
        """The present state."""
        engine = self._robot.read()
        pressed = np.any(engine.forces != 0, axis=1).reshape(2, 2)
        return MeasuredState(engine.qpos, engine.qvel, np.any(pressed, axis=1))

    def depth(self) -> Float[np.ndarray, "height width"]:
        """A depth image [m] from where the camera is now, 0 = no return."""
        return self.depth_from(self._robot.read().qpos)

    def depth_from(self, qpos: Float[np.ndarray, " nq"]) -> Float[np.ndarray, "height width"]:
        """A depth image [m] from where the camera is in a state, a little while ago perhaps."""
        self._camera_state, depth = self._take(qpos, self._camera_state)
        return np.asarray(depth)

    def clearance(self) -> float:
        """[m] from the body to the nearest obstacle."""
        return float(self._clearance(self._robot.read().qpos))

    def step(self, torques: Float[np.ndarray, " nu"]) -> None:
        """One step of the physics under motor torques [N m]."""
        self._robot.step(torques, np.zeros(3), False)
