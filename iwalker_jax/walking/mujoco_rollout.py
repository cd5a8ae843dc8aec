"""The same walk on C MuJoCo: the JAX mind of `walking` decides for a few robots at once, the C engine moves each."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array

from iwalker_jax.control.footstep_plan import FootstepPlan
from iwalker_jax.robot.model import CONTACT_POINTS
from iwalker_jax.robot.rigid_body import rigid_body_terms
from iwalker_jax.robot.variation import vary_mujoco
from iwalker_jax.walking.rollout import (
    Conditions,
    Mind,
    Sample,
    Walker,
    decide,
    felt,
    has_fallen,
    make_sample,
    push_at,
    start_mind,
)


def roll_out_mujoco(
    walker: Walker, model: mujoco.MjModel, conditions: Conditions, plan: FootstepPlan, samples: int, every: int = 10
) -> Sample:
    """Walk a batch of robots in C MuJoCo; the record is that of `walking.roll_out`, batch first.

    Args:
        walker: the robot and its mind.
        model: the same robot as a C model.
        conditions: with a leading batch axis.
        plan: of all robots, or with a leading batch axis.
        samples: recording intervals of `every` ticks.
    """
    count = conditions.friction.shape[0]
    robots = [_Robot(model, jax.tree.map(lambda leaf, k=k: leaf[k], conditions)) for k in range(count)]
    mind = _start_minds(walker, conditions)
    records: list[Any] = []
    for tick in range(samples * every):
        felt_now = jax.tree.map(lambda *parts: np.stack(parts), *(robot.feel() for robot in robots))
        mind, action, sample = _think_all(walker, conditions, plan, mind, felt_now)
        torques, pushes, lying = (np.asarray(part) for part in action)
        for robot, torque, push, lies in zip(robots, torques, pushes, lying, strict=True):
            robot.move(torque, push, bool(lies))
        if tick % every == 0:
            records.append(jax.tree.map(np.array, sample))
        else:
            last = records[-1]
            np.maximum(last.torques, sample.torques, out=last.torques)
            np.maximum(last.qp_residual, sample.qp_residual, out=last.qp_residual)
            np.add(last.qp_failures, sample.qp_failures, out=last.qp_failures)
    return jax.tree.map(lambda *parts: np.stack(parts, axis=1), *records)


class _Feeling(NamedTuple):
    """What the engine says of one robot before a tick; arrays of its float type."""

    time: Any
    qpos: Any
    qvel: Any
    forces: Any
    specific_force: Any
    fallen: Any


def _think(
    walker: Walker, conditions: Conditions, plan: FootstepPlan, mind: Mind, feeling: _Feeling
) -> tuple[Mind, tuple[Array, Array, Array], Sample]:
    """One robot's tick but for the physics: memory, (torques, push, fallen) and record."""
    pressed = jnp.any(feeling.forces != 0, axis=1)
    mind = felt(mind, pressed, feeling.specific_force)
    truth = rigid_body_terms(walker.robot, feeling.qpos, feeling.qvel)
    after, decision = decide(walker, conditions, plan, mind, feeling.qpos, feeling.qvel, truth)
    lies = feeling.fallen | has_fallen(walker, feeling.qpos, feeling.qvel)
    after = jax.tree.map(lambda new, old: jnp.where(lies, old, new), after, mind)
    sample = make_sample(feeling.time, feeling.qpos, truth, after, decision, feeling.forces, lies)
    return after, (decision.torques, push_at(conditions, feeling.time), lies), sample


@jax.jit
def _think_all(
    walker: Walker, conditions: Conditions, plan: FootstepPlan, minds: Mind, feelings: _Feeling
) -> tuple[Mind, tuple[Array, Array, Array], Sample]:
    """All robots' ticks; compiled once for each number of robots and of the plan's rows."""
    plan_axis = 0 if plan.yaws.ndim == 2 else None
    return jax.vmap(_think, in_axes=(None, 0, plan_axis, 0, 0))(walker, conditions, plan, minds, feelings)


@jax.jit
def _start_minds(walker: Walker, conditions: Conditions) -> Mind:
    return jax.vmap(start_mind, in_axes=(None, 0))(walker, conditions)


class _Robot:
    """One robot in the C engine."""

    def __init__(self, model: mujoco.MjModel, conditions: Conditions) -> None:
        self.model = vary_mujoco(model, mass_scale=float(conditions.mass_scale), friction=float(conditions.friction))
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = conditions.qpos
        self.data.qvel[:] = conditions.qvel
        mujoco.mj_forward(self.model, self.data)
        self.dtype = np.asarray(conditions.qpos).dtype
        self.base = int(self.model.jnt_bodyid[0])
        self.imu = self.model.site("imu").id
        self.points = {self.model.geom(name).id: k for k, name in enumerate(CONTACT_POINTS)}
        self.fallen = False

    def feel(self) -> _Feeling:
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
        return _Feeling(time, qpos, qvel, force, specific, np.array(self.fallen))

    def move(self, torques: np.ndarray, push: np.ndarray, fallen: bool) -> None:
        """One physics step, unless the robot lies."""
        self.fallen = fallen
        if not fallen:
            self.data.ctrl[:] = torques
            self.data.xfrc_applied[self.base, :3] = push
            mujoco.mj_step(self.model, self.data)
