"""Gradients of a walk (controller, QP and contact physics) beside finite differences, and what they cost.

A foot lands in a tick; where a step of the differences would move that to another tick, a shorter one is taken.

python -m benchmarks.walking_gradients
"""

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

from collections.abc import Callable, Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group
from bruce_model import load_mujoco
from iwalker_jax.control import FootstepPlan, make_controller, make_plan, velocity_footsteps
from iwalker_jax.optimization import QpSettings
from iwalker_jax.robot import load_leg_kinematics, load_robot_model
from iwalker_jax.walking import Conditions, Walker, WalkState, start_walk, walk_tick

_INTO_THE_WALK = 700  # ticks: 1.4 s, in the middle of the second step
_STEPS = (1e-6, 1e-7, 1e-8)  # of the differences, longest first


def setting() -> tuple[Walker, Conditions, FootstepPlan, WalkState]:
    """A robot in mid-step, in double precision."""
    model = load_mujoco()
    robot = load_robot_model(model)
    walker = Walker(robot, make_controller(robot, solver=QpSettings()), load_leg_kinematics(model))
    one = jnp.ones(())
    conditions = Conditions(
        friction=0.8 * one,
        mass_scale=one,
        push_force=jnp.zeros(3),
        push_start=100 * one,
        push_time=0.1 * one,
        delay=jnp.zeros((), jnp.int32),
        qpos=robot.home,
        qvel=jnp.zeros(22),
        key=jax.random.key(0),
        images_lost=jnp.asarray(False),
    )
    table = make_plan(*velocity_footsteps(0.15, 0.0, 0.0, 20, 0.24, 0.1, 1), 1)
    plan = jax.tree.map(lambda leaf: leaf.astype(jnp.float64) if leaf.dtype == jnp.float32 else leaf, table)
    state = jax.jit(start_walk)(walker, conditions)
    forward = jax.jit(lambda w, c, p, s: jax.lax.fori_loop(0, _INTO_THE_WALK, lambda _, x: walk_tick(w, c, p, x)[0], s))
    return walker, conditions, plan, forward(walker, conditions, plan, state)


def measure(options: Options) -> Iterator[Group | Fact]:
    """All figures of this benchmark, in double precision."""
    with jax.enable_x64(True):
        walker, conditions, plan, state = setting()
        weights = jnp.asarray(np.random.default_rng(0).normal(size=23))

        def outcome(ticks: int) -> Callable:
            def value(inputs: dict[str, jax.Array]) -> tuple[jax.Array, jax.Array]:
                physics = state.physics._replace(
                    qvel=state.physics.qvel + inputs["velocity"],
                    qpos=state.physics.qpos.at[7:].add(inputs["joints"]),
                )
                moved_plan = plan._replace(positions=plan.positions + inputs["footsteps"])
                varied = conditions._replace(mass_scale=1 + inputs["mass"])
                start = state._replace(physics=physics)
                end, _ = jax.lax.scan(
                    lambda s, _: (jax.checkpoint(walk_tick)(walker, varied, moved_plan, s)[0], None),
                    start,
                    None,
                    length=ticks,
                )
                return weights @ end.physics.qpos, end.memory.controller.gait.time

            return value

        inputs = {
            "velocity": jnp.zeros(22),
            "joints": jnp.zeros(16),
            "footsteps": jnp.zeros(plan.positions.shape),
            "mass": jnp.zeros(()),
        }
        for ticks in (1, 10) if options.quick else (1, 10, 120):
            yield from compare(outcome(ticks), inputs, ticks)


def compare(value: Callable, inputs: dict[str, jax.Array], ticks: int) -> Iterator[Group | Fact]:
    """Directional derivatives of one roll-out length; `value` also tells the step clock's time at its end."""
    plain = jax.jit(value)
    reverse = jax.jit(jax.value_and_grad(lambda x: value(x)[0]))
    forward = jax.jit(lambda x, d: jax.jvp(lambda y: value(y)[0], (x,), (d,))[1])
    rows = [
        Contender("ours, value", "ours", partial(plain, inputs), ticks),
        Contender("ours, value and gradient", "ours", partial(reverse, inputs), ticks),
    ]
    yield contest(f"Walk of {ticks} ticks", "a tick", rows, 3)
    _, gradient = reverse(inputs)
    rng = np.random.default_rng(1)
    for name in inputs:
        direction = {key: jnp.zeros(leaf.shape) for key, leaf in inputs.items()}
        direction[name] = jnp.asarray(rng.normal(size=inputs[name].shape))
        for step in _STEPS:
            (up, late), (down, early) = (
                plain(jax.tree.map(lambda x, d, h=h: x + h * d, inputs, direction)) for h in (step, -step)
            )
            if late == early:
                break
        numeric = float(up - down) / (2 * step)
        backward = float(sum(jnp.vdot(gradient[key], direction[key]) for key in inputs))
        along = float(forward(inputs, direction))
        scale = max(abs(numeric), 1e-9)
        errors = [abs(x - numeric) / scale for x in (backward, along)]
        for mode, error in zip(("reverse", "forward"), errors, strict=True):
            yield Fact(f"{ticks} ticks, by {name}: {mode} mode off from differences by", error, "of their size")


if __name__ == "__main__":
    options = tyro.cli(Options, description=__doc__)
    present(measure(options), options)
