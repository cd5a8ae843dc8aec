"""Our step of the MJX model beside MJX's own and C MuJoCo's roll-outs: time of one robot and many, derivatives, walks.

Run with `python -m benchmarks.choices.physics_step`. All move the same standing robots under the same torques, ours as
the last part of a control tick whose kinematics are there already; the others make their own. `--walk` also walks with
each, controller and all.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro

from benchmarks.peers.mujoco_rollouts import rollout_call
from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group, Kind, Row, Work
from bruce_model import load_mujoco
from iwalker_jax.api import walk
from iwalker_jax.api.walking import Engine
from iwalker_jax.robot import (
    PhysicsState,
    RobotModel,
    complete_step,
    complete_step_by_mjx,
    initial_state,
    load_robot_model,
    smooth_stages,
)
from iwalker_jax.walking import Motion

STEPS: dict[str, Callable] = {"ours": complete_step, "mjx.step": complete_step_by_mjx}
THREADS = (1, 2)
_TICKS = 50  # far enough for contacts, near enough that rounding has not grown into another motion


@dataclass(frozen=True)
class Config(Options):
    """Time steps of the physics, and walks by each of them.

    Attributes:
        batches: robots side by side; 16 alone with --quick.
        repeats: turns; 3 with --quick.
        walk: seconds that are also walked in place by each, controller and all.
    """

    batches: tuple[int, ...] = (1, 16, 64)
    repeats: int = 5
    walk: float = 0.0


def standing_robots(robot: RobotModel, count: int) -> tuple[PhysicsState, jax.Array]:
    """States that press on the floor, and torques that differ a little from robot to robot."""
    rng = np.random.default_rng(0)
    qpos = jnp.tile(robot.home.at[2].add(-0.0005), (count, 1))
    qvel = jnp.asarray(0.02 * rng.normal(size=(count, robot.motor_moments.shape[1])), qpos.dtype)
    torques = jnp.asarray(0.1 * rng.normal(size=(count, robot.motor_moments.shape[0])), qpos.dtype)
    return jax.vmap(partial(initial_state, robot))(qpos, qvel), torques


def rolled(step: Callable, robot: RobotModel, state: PhysicsState, torques: jax.Array) -> PhysicsState:
    """State of one robot after `_TICKS` steps, kinematics included."""

    def tick(state: PhysicsState, _: None) -> tuple[PhysicsState, None]:
        return step(robot, state, smooth_stages(robot, state.qpos, state.qvel), torques)[0], None

    return jax.lax.scan(tick, state, None, length=_TICKS)[0]


def height(step: Callable, robot: RobotModel, state: PhysicsState, torques: jax.Array) -> jax.Array:
    """A number of the last state, to differentiate by the torques."""
    return rolled(step, robot, state, torques).qpos[2]


def slope_forward(step: Callable, robot: RobotModel, state: PhysicsState, torques: jax.Array) -> jax.Array:
    """Derivative of the height along one direction, in forward mode."""
    value = partial(height, step, robot, state)
    return jax.jvp(value, (torques,), (jnp.ones_like(torques),))[1]


def slope_reverse(step: Callable, robot: RobotModel, state: PhysicsState, torques: jax.Array) -> jax.Array:
    """Derivative of the height by all torques, in reverse mode."""
    return jax.grad(partial(height, step, robot, state))(torques)


def kind_of(name: str) -> Kind:
    """Ours, or a peer's."""
    return "ours" if name == "ours" else "peer"


def worst_apart(exact: np.ndarray, states: PhysicsState | np.ndarray) -> dict[str, float]:
    """Largest distance of the positions at the end from C MuJoCo's."""
    qpos = states.qpos if isinstance(states, PhysicsState) else states[:, : exact.shape[1]]
    return {"positions apart [m, rad]": float(np.max(np.abs(np.asarray(qpos, float) - exact)))}


def by_robots(robot: RobotModel, model: mujoco.MjModel, count: int, repeats: int) -> Group:
    """A robot's step by everyone, of some robots side by side."""
    states, torques = standing_robots(robot, count)
    qpos, qvel, motors = (np.asarray(leaf, float) for leaf in (states.qpos, states.qvel, torques))
    by_threads = {threads: rollout_call(model, qpos, qvel, motors, _TICKS, threads) for threads in THREADS}
    judge = partial(worst_apart, by_threads[1]()[:, : model.nq])
    rows = []
    for name, step in STEPS.items():
        call = partial(jax.jit(jax.vmap(partial(rolled, step), in_axes=(None, 0, 0))), robot, states, torques)
        work = Work(steps=1 / count) if name == "ours" else None
        rows.append(Contender(name, kind_of(name), call, count * _TICKS, judge, work))
    for threads, rollout in by_threads.items():
        if threads <= count:
            name = f"mujoco.rollout, {threads} thread{'s' * (threads > 1)}"
            rows.append(Contender(name, "peer", rollout, count * _TICKS, judge, compiles=False))
    title = f"{_TICKS} steps of 2 ms, {count} robot{'s side by side' * (count > 1)}"
    return contest(title, "a robot's step", rows, repeats)


def derivatives(robot: RobotModel, repeats: int) -> Iterator[Group]:
    """Steps with a derivative; JAX refuses the reverse mode of MJX's contact solver."""
    states, torques = standing_robots(robot, 1)
    ways = {"along one direction, forward mode": slope_forward, "by all torques, reverse mode": slope_reverse}
    for title, function in ways.items():
        kinds = ("ours",) if function is slope_reverse else tuple(STEPS)
        rows = []
        for name in kinds:
            one = jax.jit(jax.vmap(partial(function, STEPS[name]), in_axes=(None, 0, 0)))
            rows.append(Contender(name, kind_of(name), partial(one, robot, states, torques), _TICKS))
        yield contest(f"Steps with the derivative {title}", "a step", rows, repeats)


def apart_after_one(robot: RobotModel) -> Iterator[Fact]:
    """How far our step and MJX's are apart after one."""
    states, torques = standing_robots(robot, 16)

    def once(step: Callable, state: PhysicsState, torque: jax.Array) -> PhysicsState:
        return step(robot, state, smooth_stages(robot, state.qpos, state.qvel), torque)[0]

    ours, theirs = (jax.jit(jax.vmap(partial(once, step)))(states, torques) for step in STEPS.values())
    for name, unit in (("qpos", "m, rad"), ("qvel", "m/s, rad/s")):
        apart = float(jnp.max(jnp.abs(getattr(ours, name) - getattr(theirs, name))))
        yield Fact(f"{name} apart from mjx.step's after one step", apart, unit)


def walks(seconds: float) -> Group:
    """The same walk in place by each engine, controller and all; one run of each, so that there is no spread."""
    rows = []
    engines: dict[str, Engine] = {"ours": "mjx", "mjx.step": "mjx.step", "C MuJoCo, our controller": "mujoco"}
    for name, engine in engines.items():
        result = walk(Motion("in_place", seconds=seconds), engine=engine)
        taken = result.batch.seconds / seconds
        end = {"height at the end [m]": float(result.batch.sample.qpos[0, -1, 2])}
        rows.append(Row(name, kind_of(name), (taken,), result.batch.compile_seconds, accuracy=end))
    return Group(f"A walk of {seconds:g} s, one robot, controller and all", "a simulated second", tuple(rows))


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    model = load_mujoco()
    robot = load_robot_model(model)
    repeats = min(config.repeats, 3) if config.quick else config.repeats
    for count in (16,) if config.quick else config.batches:
        yield by_robots(robot, model, count, repeats)
    if not config.quick:
        yield from derivatives(robot, repeats)
    yield from apart_after_one(robot)
    if config.walk:
        yield walks(config.walk)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)
