"""The same walk on C MuJoCo: sensing and control of `rollout` for a few robots at once in JAX, physics of each in C."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array

from iwalker_jax.control import FootstepPlan
from iwalker_jax.robot import RobotModel, rigid_body_terms, vary_mujoco
from iwalker_jax.walking.rollout import (
    Conditions,
    ControllerMemory,
    Sample,
    Walker,
    after_physics,
    has_fallen,
    make_sample,
    push_at,
    sense_and_control,
    start_memory,
)


def roll_out_mujoco(
    walker: Walker, model: mujoco.MjModel, conditions: Conditions, plan: FootstepPlan, samples: int, every: int = 10
) -> Sample:
    """Walk a batch of robots in C MuJoCo; the record is that of `rollout.roll_out`, batch first.

    Args:
        walker: the robot with its controller.
        model: the same robot as a C model.
        conditions: with a leading batch axis.
        plan: of all robots, or with a leading batch axis.
        samples: recording intervals of `every` ticks.
    """
    count = conditions.friction.shape[0]
    robots = [
        MujocoRobot(walker.robot, model, jax.tree.map(lambda leaf, k=k: leaf[k], conditions)) for k in range(count)
    ]
    memory = _start_memories(walker, conditions)
    records: list[Any] = []
    for tick in range(samples * every):
        before = jax.tree.map(lambda *parts: np.stack(parts), *(robot.read() for robot in robots))
        memory, action, sample = _tick_all(walker, conditions, plan, memory, before)
        torques, pushes, fallen = (np.asarray(part) for part in action)
        for robot, torque, push, down in zip(robots, torques, pushes, fallen, strict=True):
            robot.step(torque, push, bool(down))
        if tick % every == 0:
            records.append(jax.tree.map(np.array, sample))
        else:
            last = records[-1]
            np.maximum(last.torques, sample.torques, out=last.torques)
            np.maximum(last.qp_residual, sample.qp_residual, out=last.qp_residual)
            np.add(last.qp_failures, sample.qp_failures, out=last.qp_failures)
    return jax.tree.map(lambda *parts: np.stack(parts, axis=1), *records)


class EngineState(NamedTuple):
    """What the engine says of one robot before a tick; arrays of its float type."""

    time: Any
    qpos: Any
    qvel: Any
    forces: Any
    specific_force: Any
    fallen: Any


def _tick(
    walker: Walker, conditions: Conditions, plan: FootstepPlan, memory: ControllerMemory, engine: EngineState
) -> tuple[ControllerMemory, tuple[Array, Array, Array], Sample]:
    """One robot's tick but for the physics: memory, (torques, push, fallen) and record."""
    pressed = jnp.any(engine.forces != 0, axis=1)
    memory = after_physics(memory, pressed, engine.specific_force)
    truth = rigid_body_terms(walker.robot, engine.qpos, engine.qvel)
    after, output = sense_and_control(walker, conditions, plan, memory, engine.qpos, engine.qvel, truth)
    fallen = engine.fallen | has_fallen(walker, engine.qpos, engine.qvel)
    after = jax.tree.map(lambda new, old: jnp.where(fallen, old, new), after, memory)
    sample = make_sample(engine.time, engine.qpos, truth, after, output, engine.forces, fallen)
    return after, (output.torques, push_at(conditions, engine.time), fallen), sample


@jax.jit
def _tick_all(
    walker: Walker, conditions: Conditions, plan: FootstepPlan, memories: ControllerMemory, engines: EngineState
) -> tuple[ControllerMemory, tuple[Array, Array, Array], Sample]:
    """All robots' ticks; compiled once for each number of robots and of the plan's rows."""
    plan_axis = 0 if plan.yaws.ndim == 2 else None
    return jax.vmap(_tick, in_axes=(None, 0, plan_axis, 0, 0))(walker, conditions, plan, memories, engines)


@jax.jit
def _start_memories(walker: Walker, conditions: Conditions) -> ControllerMemory:
    return jax.vmap(start_memory, in_axes=(None, 0))(walker, conditions)


class MujocoRobot:
    """One robot in the C engine."""

    def __init__(self, robot: RobotModel, model: mujoco.MjModel, conditions: Conditions) -> None:
        self.model = vary_mujoco(model, mass_scale=float(conditions.mass_scale), friction=float(conditions.friction))
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = conditions.qpos
        self.data.qvel[:] = conditions.qvel
        mujoco.mj_forward(self.model, self.data)
        self.dtype = np.asarray(conditions.qpos).dtype
        self.base = int(self.model.jnt_bodyid[0])
        self.imu = self.model.site("imu").id
        self.points = {geom: k for k, geom in enumerate(robot.contact_geoms)}
        self.fallen = False

    def read(self) -> EngineState:
        """State, and the contact forces and specific force of the last step."""
        data, forces = self.data, np.zeros((len(self.points), 3))
        wrench = np.zeros(6)
        for k in range(data.ncon):
            contact = data.contact[k]
            mujoco.mj_contactForce(self.model, data, k, wrench)
            world = contact.frame.reshape(3, 3).T @ wrench[:3]
            # The force acts on the second geom; the first one feels its opposite.
            for geom, sign in ((contact.geom2, 1.0), (contact.geom1, -1.0)):
                if geom in self.points:
                    forces[self.points[geom]] += sign * world
        acceleration = np.zeros(6)
        mujoco.mj_objectAcceleration(self.model, data, mujoco.mjtObj.mjOBJ_SITE, self.imu, acceleration, True)
        time, qpos, qvel, force, specific = (
            np.array(part, self.dtype) for part in (data.time, data.qpos, data.qvel, forces, acceleration[3:])
        )
        return EngineState(time, qpos, qvel, force, specific, np.array(self.fallen))

    def step(self, torques: np.ndarray, push: np.ndarray, fallen: bool) -> None:
        """One physics step, unless the robot fallen."""
        self.fallen = fallen
        if not fallen:
            self.data.ctrl[:] = torques
            self.data.xfrc_applied[self.base, :3] = push
            mujoco.mj_step(self.model, self.data)
