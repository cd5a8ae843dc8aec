"""Large batches on an accelerator: values checked against this machine's processor, and the times of both.

Run with `python -m benchmarks --gpu`, or `python -m benchmarks.accelerator`. 65,536 whole-body QPs, 4,096 robots in the
physics and in whole control ticks, plans, distance fields and depth images. The processor is given few of them, because
it would take minutes for all. A part is begun only while there is time for it.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from iwalker_jax.runtime.settings import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks import floor
from benchmarks.choices.physics_step import STEPS, rolled, standing_robots
from benchmarks.problems.unicycle_references import references
from benchmarks.problems.whole_body_qps import whole_body_qps
from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group, Work
from bruce_model import load_mujoco
from iwalker_jax.control import make_plan, velocity_footsteps
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import (
    QuadraticProgram,
    control_settings,
    initial_state_from_reference,
    solve_qp,
    solve_unicycle,
)
from iwalker_jax.perception import CameraMount, Intrinsics, signed_distance_field
from iwalker_jax.robot import load_robot_model
from iwalker_jax.scenes import generate_scene, render_depth, world_camera_pose
from iwalker_jax.walking import Disturbances, default_walker, sample_conditions, start_walk, walk_tick

_LAST_START = 300.0
"""[s] after which no further part is begun: compiling one may take a minute or two."""

_TICKS = 20
"""Control ticks in a row, 40 ms."""

_IMAGE = Intrinsics(160, 90, 80.0, 80.0, 79.5, 44.5)


@dataclass(frozen=True)
class Config(Options):
    """Check and time large batches.

    Attributes:
        programs: QPs side by side; 256 with --quick.
        robots: robots side by side; 32 with --quick. As many plans, fields and images.
        checked: of each, that the processor computes too; a quarter with --quick.
        anyway: go on without an accelerator, on the processor, for trying the set out.
    """

    programs: int = 65536
    robots: int = 4096
    checked: int = 64
    anyway: bool = False


@dataclass(frozen=True)
class Part:
    """Something to compute in a batch.

    Attributes:
        title: what.
        item: what a time is of.
        one: of one row; an array, or several.
        rows: arguments with a leading batch axis.
        items: items a row.
        tolerance: difference between the devices that single precision leaves, by the size of the values.
    """

    title: str
    item: str
    one: Callable[..., Any]
    rows: tuple[Any, ...]
    tolerance: float
    items: int = 1


def parts(programs: int, robots: int) -> Iterator[Part]:
    """The most telling first."""
    yield qp_part(programs)
    yield physics_part(robots)
    yield walking_part(robots)
    paths = jnp.asarray(references(robots))
    starts = jax.vmap(initial_state_from_reference)(paths)
    yield Part("plans", "a path", lambda r, s: solve_unicycle(r, s).value.path, (paths, starts), 1e-2)
    occupied = jnp.asarray(np.random.default_rng(0).random((robots, 160, 160)) < 0.01)
    yield Part("distance fields, 160 x 160", "a map", lambda o: signed_distance_field(o, 0.05), (occupied,), 1e-5)
    yield rendering_part(robots)


def qp_part(count: int) -> Part:
    """Whole-body QPs from no guess, by the control loop's settings."""
    walk = whole_body_qps(min(count, 256))
    again = np.arange(count) % len(walk.q)
    rows = tuple(jnp.asarray(leaf, jnp.float32)[again] for leaf in walk[:5])

    def point(P: jax.Array, q: jax.Array, C: jax.Array, low: jax.Array, high: jax.Array) -> jax.Array:
        return solve_qp(QuadraticProgram(P, q, C, low, high), None, control_settings(), "stopped").value.x

    return Part("whole-body QPs", "a QP", point, rows, 1e-2)


def physics_part(count: int) -> Part:
    """Standing robots under constant torques."""
    robot = load_robot_model(load_mujoco())

    def moved(state: Any, torques: jax.Array) -> jax.Array:
        return rolled(STEPS["ours"], robot, state, torques).qpos

    return Part("steps of the physics", "50 steps", moved, standing_robots(robot, count), 1e-3)


def walking_part(count: int) -> Part:
    """Control ticks: sensors, controller, QP and physics of robots that begin to walk."""
    walker, _ = default_walker("none")
    plan = make_plan(*velocity_footsteps(0.1, 0.0, 0.0, 40, 0.24, 0.1, 1), 1)
    conditions = sample_conditions(walker.robot, Disturbances(), count, 0)

    def walked(conditions: Any) -> jax.Array:
        start = start_walk(walker, conditions)
        return jax.lax.fori_loop(0, _TICKS, lambda _, s: walk_tick(walker, conditions, plan, s)[0], start).physics.qpos

    return Part("control ticks with physics", "a tick", walked, (conditions,), 1e-3, _TICKS)


def rendering_part(count: int) -> Part:
    """Depth images of one scene from many headings."""
    scene = generate_scene("living_room", 1)
    arrays, mount = scene.arrays(), CameraMount().as_array()
    x, y = (scene.bounds[0] + scene.bounds[2]) / 2, (scene.bounds[1] + scene.bounds[3]) / 2
    yaws = np.linspace(0, 2 * np.pi, count, endpoint=False)
    poses = jnp.asarray(np.stack([np.full(count, x), np.full(count, y), yaws], axis=1), jnp.float32)

    def image(pose: jax.Array) -> jax.Array:
        return render_depth(arrays, _IMAGE, *world_camera_pose(pose, mount))

    return Part("depth images, 160 x 90", "an image", image, (poses,), 1e-3)


def compare(part: Part, checked: int, device: jax.Device, host: jax.Device) -> Group:
    """A part on the accelerator, all of it, and on the processor, its first rows."""
    count = jax.tree.leaves(part.rows)[0].shape[0]
    few = jax.tree.map(lambda leaf: leaf[:checked], part.rows)
    program = jax.jit(jax.vmap(part.one))
    there, here = jax.device_put(part.rows, device), jax.device_put(few, host)
    exact = np.asarray(program(*here), float)
    size = max(float(np.max(np.abs(exact))), 1.0)

    def judge(values: np.ndarray) -> dict[str, float]:
        apart = np.abs(np.asarray(values[:checked], float) - exact) / size
        rows = np.max(apart.reshape(len(apart), -1), axis=1)
        return {
            "worst difference": float(rows.max()),
            "rows off": float(np.mean(~(rows <= part.tolerance))),
            "not finite": float(np.mean(~np.isfinite(values))),
        }

    work = Work(bytes=sum(leaf.nbytes for leaf in jax.tree.leaves(part.rows)) / (count * part.items))
    mine, its = f"ours, {count} on {device.device_kind}", f"ours, {checked} on the processor"
    rows = [
        Contender(mine, "ours", partial(program, *there), count * part.items, judge, work),
        Contender(its, "peer", partial(program, *here), checked * part.items),
    ]
    return contest(f"{count} {part.title}", part.item, rows, 5)


def accelerator(anyway: bool) -> jax.Device:
    """The device to check.

    Raises:
        InputError: if JAX sees none but processors.
    """
    device = jax.devices()[0]
    if device.platform == "cpu" and not anyway:
        raise InputError(
            "JAX sees no accelerator here, so there is nothing to check: this set is for a machine with one, and a JAX "
            "installed for it (pip install 'jax[cuda13]')."
        )
    return device


def measure(config: Config, device: jax.Device) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    began = time.monotonic()
    yield from floor.measure(config)
    host = jax.devices("cpu")[0]
    programs, robots, checked = (256, 32, 16) if config.quick else (config.programs, config.robots, config.checked)
    for part in parts(programs, robots):
        if time.monotonic() - began > _LAST_START:
            yield Fact(f"{part.title}: left out for want of time", 1.0)
            continue
        group = compare(part, min(checked, robots), device, host)
        yield group
        wrong = group.rows[0].accuracy["rows off"]
        yield Fact(f"{part.title}: rows whose values differ by more than {part.tolerance:g}", 100 * wrong, "%")


def main() -> None:
    """Run the command."""
    config = tyro.cli(Config, description=__doc__)
    try:
        device = accelerator(config.anyway)
    except InputError as error:
        raise SystemExit(f"error: {error}") from error
    present(measure(config, device), config)


if __name__ == "__main__":
    main()
