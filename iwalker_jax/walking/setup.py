"""Who walks and in what conditions: the robot with its controller, and what disturbs each robot of a batch."""

from dataclasses import dataclass
from typing import Literal

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from iwalker_jax.arrays import as_doubles
from iwalker_jax.checks import require_numbers, require_whole
from iwalker_jax.control import GaitParameters, make_controller
from iwalker_jax.errors import InputError
from iwalker_jax.estimation import SensorNoise
from iwalker_jax.humanoids import RobotDescription, build_model, load_robot
from iwalker_jax.optimization import QpMethod, control_settings
from iwalker_jax.robot import RobotModel, load_leg_kinematics, load_robot_model
from iwalker_jax.streams import check_seed
from iwalker_jax.walking.rollout import MAX_DELAY, Conditions, Walker

Sensors = Literal["none", "nominal", "harsh"]
"""Sensor noise of a walk: the true state, or the estimate from nominal or harsh readings."""

STEP_TIME = float(GaitParameters().hlip.step_time)
"""[s] of a step of the default controller."""


MOST_ROBOTS = 65_536
"""Of a batch."""


def default_walker(
    sensors: Sensors = "none",
    gait: GaitParameters | None = None,
    solver: QpMethod = "active_set",
    description: RobotDescription | None = None,
) -> tuple[Walker, mujoco.MjModel]:
    """A robot with its controller, and the same robot for the C engine.

    Args:
        sensors: `none` feeds the true state back; otherwise the estimator walks on simulated sensors.
        gait: of the controller; the robot's own if left out.
        solver: of its whole-body QPs.
        description: of the robot; BRUCE's if left out.
    """
    noises = {"none": None, "nominal": SensorNoise.nominal(), "harsh": SensorNoise.harsh()}
    if not isinstance(sensors, str) or sensors not in noises:
        raise InputError(f"Unknown sensors {sensors!r}; choose one of {', '.join(noises)}.")
    if gait is not None and not isinstance(gait, GaitParameters):
        raise InputError(f"The gait is a {type(gait).__name__}; give GaitParameters.")
    description = description or load_robot("bruce")
    model = build_model(description)
    robot = load_robot_model(model)
    return Walker(
        robot,
        make_controller(robot, gait or description.gait, description.tasks, control_settings(solver)),
        load_leg_kinematics(model),
        noises[sensors],
    ), model


@dataclass(frozen=True)
class Disturbances:
    """Ranges from which each robot's conditions are drawn.

    Attributes:
        friction: least and largest coefficient.
        mass: largest relative change of all masses.
        start_position: [m] and [rad], start_velocity: [m/s]; largest errors of the start state.
        push_impulse: [N s] on the torso, of random sign; 0 for none.
        push_axis: of the world.
        push_after: [s] earliest push; it comes within two steps from then, at a random time.
        push_time: [s] that it lasts.
        delay: least and largest delay of the torques [ticks].
    """

    friction: tuple[float, float] = (0.5, 1.0)
    mass: float = 0.05
    start_position: float = 0.01
    start_velocity: float = 0.03
    push_impulse: float = 0.0
    push_axis: Literal["x", "y"] = "x"
    push_after: float = 4.0
    push_time: float = 0.1
    delay: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        require_numbers(self)
        for name in ("friction", "delay"):
            shape = as_doubles(getattr(self, name), f"Disturbances.{name}").shape
            if shape != (2,):
                raise InputError(f"Disturbances.{name} is of shape {shape}; give its least and its largest value.")
        if not 0.05 <= self.friction[0] <= self.friction[1] <= 5.0:
            raise InputError(f"Friction from {self.friction[0]} to {self.friction[1]}; give 0.05 to 5, smaller first.")
        if not 0 <= self.delay[0] <= self.delay[1] <= MAX_DELAY:
            raise InputError(f"A delay of {self.delay} ticks; give 0 to {MAX_DELAY}, smaller first.")
        bounds = {
            "mass": 0.5,
            "start_position": 0.05,
            "start_velocity": 0.5,
            "push_impulse": 100.0,
            "push_after": 3600.0,
        }
        for name, high in bounds.items():
            if not 0 <= getattr(self, name) <= high:
                raise InputError(f"Disturbances.{name} is {getattr(self, name)}; give 0 to {high:g}.")
        if not 0.002 <= self.push_time <= 10.0:
            raise InputError(f"Disturbances.push_time is {self.push_time} s; give 0.002 to 10 s.")
        if self.push_axis not in ("x", "y"):
            raise InputError(f"Disturbances.push_axis is {self.push_axis!r}; give x or y.")


def sample_conditions(
    robot: RobotModel, disturbances: Disturbances, count: int, seed: int, step_time: float = STEP_TIME
) -> Conditions:
    """Conditions of `count` robots, batch first; robot k of a seed is the same whatever the count.

    Args:
        robot: that walks.
        disturbances: ranges to draw from.
        count, seed: robots, and of their draws.
        step_time: [s] of a step, of the walker's controller if it is not the default one.

    Raises:
        InputError: no robot, more than `MOST_ROBOTS`, or a bad seed.
    """
    check_robots(count, seed)
    if not isinstance(disturbances, Disturbances):
        raise InputError(f"The disturbances are a {type(disturbances).__name__}; give Disturbances.")
    rows = [_draw(robot, disturbances, np.random.default_rng((seed, k)), step_time) for k in range(count)]
    friction, mass, force, start, delay, qpos, qvel = (np.stack(column) for column in zip(*rows))
    dtype = robot.home.dtype
    return Conditions(
        friction=jnp.asarray(friction, dtype),
        mass_scale=jnp.asarray(mass, dtype),
        push_force=jnp.asarray(force, dtype),
        push_start=jnp.asarray(start, dtype),
        push_time=jnp.full(count, disturbances.push_time, dtype),
        delay=jnp.asarray(delay, jnp.int32),
        qpos=jnp.asarray(qpos, dtype),
        qvel=jnp.asarray(qvel, dtype),
        key=jax.vmap(jax.random.fold_in, (None, 0))(jax.random.key(seed), jnp.arange(count)),
        images_lost=jnp.zeros(count, bool),
    )


def check_robots(count: int, seed: int) -> None:
    """Require a number of robots that a machine holds, and a seed of their draws.

    Raises:
        InputError: no robot, more than `MOST_ROBOTS`, or a bad seed.
    """
    require_whole(count, "The number of robots")
    if not 1 <= count <= MOST_ROBOTS:
        raise InputError(f"{count} robots were asked for; give 1 to {MOST_ROBOTS}.")
    check_seed(seed, "the robots' conditions")


def _draw(robot: RobotModel, d: Disturbances, rng: np.random.Generator, step_time: float) -> tuple:
    """Friction, mass scale, push force and start, delay, qpos and qvel of one robot."""
    qpos = np.array(robot.home, np.float64)
    qpos[robot.leg_positions] += rng.uniform(-d.start_position, d.start_position, robot.leg_count)
    qpos[:2] += rng.uniform(-d.start_position, d.start_position, 2)
    yaw = rng.uniform(-3, 3) * d.start_position
    turned = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    mujoco.mju_mulQuat(qpos[3:7], turned, np.array(robot.home[3:7], np.float64))
    qvel = np.zeros(robot.motor_moments.shape[1])
    qvel[:2] = rng.uniform(-d.start_velocity, d.start_velocity, 2)
    force = np.zeros(3)
    force["xy".index(d.push_axis)] = rng.choice([-1, 1]) * d.push_impulse / d.push_time
    return (
        rng.uniform(*d.friction),
        1 + rng.uniform(-d.mass, d.mass),
        force,
        d.push_after + rng.uniform(0, 2 * step_time),
        rng.integers(d.delay[0], d.delay[1] + 1),
        qpos,
        qvel,
    )
