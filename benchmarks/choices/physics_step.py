"""Our step of the MJX model beside MJX's own `mjx.step`: equal values, time alone and in batches, and derivatives.

Run with `python -m benchmarks.choices.physics_step`. Both move the same standing robots under the same torques, as the
last part of a control tick whose kinematics are there already; MJX makes its own. `--walk` also walks a second with
each, controller and all.
"""

import argparse
from collections.abc import Callable
from functools import partial

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import in_turns
from bruce_model import load_mujoco
from iwalker_jax.api import walk
from iwalker_jax.robot import (
    PhysicsState,
    RobotModel,
    complete_step,
    complete_step_by_mjx,
    initial_state,
    load_robot,
    smooth_stages,
)
from iwalker_jax.runtime.devices import machine
from iwalker_jax.walking import Motion

STEPS: dict[str, Callable] = {"mjx.step": complete_step_by_mjx, "own": complete_step}
_TICKS = 100


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


def print_times(robot: RobotModel, batches: list[int], repeats: int) -> None:
    """A line for each way of running both steps; a robot's step each, of the best run, and the ratio."""
    print("| what | mjx.step [us] | own step [us] | ratio | compiling [s] |\n| --- | --- | --- | --- | --- |")
    ways: list[tuple[str, Callable, int]] = [
        (f"batch of {count}" if count > 1 else "one robot", rolled, count) for count in batches
    ]
    ways.append(("derivative along one direction, forward mode", slope_forward, 1))
    ways.append(("derivative by all torques, reverse mode", slope_reverse, 1))
    for name, function, count in ways:
        states, torques = standing_robots(robot, count)
        kinds = ("own",) if function is slope_reverse else tuple(STEPS)
        calls: dict[str, Callable] = {}
        for kind in kinds:
            one = partial(function, STEPS[kind])
            calls[kind] = partial(jax.jit(jax.vmap(one, in_axes=(None, 0, 0))), robot, states, torques)
        times = in_turns(calls, repeats)
        each = {kind: 1e6 * times[kind].best / (count * _TICKS) for kind in kinds}
        theirs = f"{each['mjx.step']:.0f}" if "mjx.step" in each else "refused by JAX"
        ratio = f"{each['mjx.step'] / each['own']:.1f}" if "mjx.step" in each else "-"
        compiling = ", ".join(f"{times[kind].first:.0f}" for kind in kinds)
        print(f"| {name} | {theirs} | {each['own']:.0f} | {ratio} | {compiling} |", flush=True)


def print_values(robot: RobotModel) -> None:
    """How far the two are apart after 1 and after `_TICKS` steps."""
    states, torques = standing_robots(robot, 16)

    def once(step: Callable, state: PhysicsState, torque: jax.Array) -> PhysicsState:
        return step(robot, state, smooth_stages(robot, state.qpos, state.qvel), torque)[0]

    for what, function in (("1 step", once), (f"{_TICKS} steps", lambda step, *rest: rolled(step, robot, *rest))):
        own, theirs = (jax.jit(jax.vmap(partial(function, step)))(states, torques) for step in STEPS.values())
        apart = [float(jnp.max(jnp.abs(getattr(own, name) - getattr(theirs, name)))) for name in ("qpos", "qvel")]
        print(f"apart after {what}: positions {apart[0]:.1e} [m, rad], velocities {apart[1]:.1e} [m/s, rad/s]")


def print_walks(seconds: float) -> None:
    """The same walk by either engine: simulated robot-seconds a second, and where it ends."""
    print("\n| walk, 1 robot | robot-seconds a second | compiling [s] | height at the end [m] | fell |")
    print("| --- | --- | --- | --- | --- |")
    for engine in ("mjx.step", "mjx"):
        result = walk(Motion("in_place", seconds=seconds), engine=engine)
        batch = result.batch
        end = batch.sample.qpos[0, -1, 2]
        rate = f"{batch.robot_seconds_per_second:.2f} | {batch.compile_seconds:.0f}"
        print(f'| engine="{engine}" | {rate} | {end:.4f} | {result.metrics[0].fallen} |', flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--batches", default="1,16,64", help="comma-separated numbers of robots")
    parser.add_argument("--repeats", type=int, default=5, help="timed runs of each")
    parser.add_argument("--walk", type=float, default=0.0, metavar="SECONDS", help="walk in place for so long as well")
    options = parser.parse_args()
    robot = load_robot(load_mujoco())
    print(f"{machine()}, float32, {_TICKS} steps of 2 ms in a scan, a robot's step each; controller left out\n")
    print_times(robot, [int(count) for count in options.batches.split(",")], options.repeats)
    print()
    print_values(robot)
    if options.walk:
        print_walks(options.walk)


if __name__ == "__main__":
    main()
