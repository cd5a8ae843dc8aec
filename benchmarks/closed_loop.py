"""Where the closed loop's time goes, how fast whole episodes are, and what each part takes for one robot.

Run with `python -m benchmarks.closed_loop [--episodes 64] [--seconds 30] [--batches 3] [--devices 2]
[--run runs/default] [--study]`. Episodes are walked from a compiled program; compilation is reported apart. A study of
several batches is walked batch after batch, and in one run in which an episode begins where one has ended.
"""

import dataclasses
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from iwalker_jax.runtime.settings import configure_runtime, requested_devices

if __name__ == "__main__":
    configure_runtime(requested_devices(sys.argv))

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from flax import nnx

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group, Row
from benchmarks.suite.timing import timed
from iwalker_jax.commands.shared.planners import planner_of
from iwalker_jax.control import control_step
from iwalker_jax.geometry import Side
from iwalker_jax.navigation import (
    EpisodeProgram,
    LoopState,
    Navigator,
    TaskBatch,
    body_clearance_at,
    camera_in_world,
    make_faults,
    make_navigator,
    place_at,
    run_episode,
    safe_path,
    start_episode,
)
from iwalker_jax.navigation.depth_camera import take_depth
from iwalker_jax.navigation.guide import (
    Guidance,
    Observation,
    guide,
    network_path,
    remember,
    route_costs,
)
from iwalker_jax.navigation.memory import (
    RouteMemory,
    route_grid,
    update_route_memory,
    window_origin,
)
from iwalker_jax.navigation.step_planning import Stance, plan_steps
from iwalker_jax.perception import (
    best_routes,
    clean_depth,
    softened,
)
from iwalker_jax.planning import (
    Planner,
    SplitModule,
    split_module,
)
from iwalker_jax.robot import (
    rigid_body_terms,
)
from iwalker_jax.scenes.depth_noise import DepthNoise
from iwalker_jax.scenes.ray_casting import render_depth
from iwalker_jax.tasks.generated import generated_tasks
from iwalker_jax.tasks.task import Task, TaskArrays, stack_tasks
from iwalker_jax.training import paper_preset, small_paper_preset
from iwalker_jax.walking import Conditions, Disturbances, sample_conditions, sense_and_control, walk_tick


@dataclass(frozen=True)
class Config(Options):
    """Time parts of the loop, whole episodes, and studies of them.

    Attributes:
        episodes: side by side; 4 with --quick.
        seconds: of an episode at most; 5 with --quick.
        batches: of the study; left out with --quick.
        devices: host devices that share the episodes.
        run: a training run's folder; the shipped planner by default.
        study: the study of several batches only.
    """

    episodes: int = 64
    seconds: float = 30.0
    batches: int = 3
    devices: int | None = None
    run: Path | None = None
    study: bool = False


REPEATS = 9
TICKS = 33
"""Control ticks that are timed in one call: those of a camera frame."""


class Setting:
    """A batch of robots in mid-episode, with everything that the parts need."""

    def __init__(self, navigator: Navigator, tasks: list[Task], warm: int = 30) -> None:
        self.navigator, self.count = navigator, len(tasks)
        self.tasks: TaskArrays = stack_tasks(tasks)
        conditions = sample_conditions(navigator.walker.robot, Disturbances(), self.count, 0)
        self.conditions: Conditions = place_at(conditions, self.tasks.start)
        faults = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (self.count, *leaf.shape)), make_faults())
        state = jax.jit(jax.vmap(start_episode, in_axes=(None, 0, 0)))(navigator, self.tasks, self.conditions)
        begin = jax.jit(jax.vmap(lambda t, c, f, s: run_episode(navigator, t, c, f, s, 1)))
        for _ in range(warm):
            state, _ = begin(self.tasks, self.conditions, faults, state)
        self.state: LoopState = state

    def time(self, part: Callable, *arguments: Any) -> float:
        """Milliseconds a robot of one call."""
        return 1e3 * timed(jax.jit(jax.vmap(part)), *arguments, repeats=REPEATS).best / self.count


def parts_of(setting: Setting) -> dict[str, tuple[float, float]]:
    """(milliseconds a call, calls a second) of each part, by name."""
    nav, state, tasks = setting.navigator, setting.state, setting.tasks
    frames = 1 / nav.frame_time
    parameters, memory_parameters = nav.guidance, nav.guidance.memory

    def render(task: TaskArrays, s: LoopState) -> jax.Array:
        return render_depth(task.scene, nav.intrinsics, *camera_in_world(nav.camera, s.walk.physics.qpos))

    def see(task: TaskArrays, s: LoopState) -> jax.Array:
        noise = nav.noise or DepthNoise()
        return take_depth(nav.camera, nav.intrinsics, noise, task.scene, s.walk.physics.qpos, s.depth_camera)[1]

    depth = jax.jit(jax.vmap(see))(tasks, state)
    mount = jnp.tile(nav.planner.merge().config.ipath.mount.as_array(), (setting.count, 1))
    base = jnp.concatenate([state.walk.physics.qpos[:, :2], tasks.start[:, 2:]], axis=1)
    observation = Observation(depth, mount, base, tasks.goals[:, 0])
    cleaned = observation._replace(depth=jax.jit(jax.vmap(clean_depth))(depth))

    def add_map(s: LoopState, at: Observation) -> tuple:
        before = s.sight.guide
        cells = remember(parameters, nav.intrinsics, before.cells, at._replace(depth=clean_depth(at.depth)))
        assert before.routes is not None  # the default policy looks for routes
        routes, esdf = update_route_memory(parameters.routes, memory_parameters, before.routes, cells)
        return routes, esdf, window_origin(memory_parameters, cells)

    routes, esdf, origin = jax.jit(jax.vmap(add_map))(state, observation)

    def route(s: LoopState, routes: RouteMemory, origin: jax.Array, at: Observation) -> tuple:
        start, goal = at.base[:2] - origin, at.goal - origin
        to_go = route_costs(parameters, routes, start, goal, s.sight.guide.route - origin)
        grid = route_grid(parameters.routes, memory_parameters)
        return best_routes(to_go, softened(routes.unseen), goal, start, grid, parameters.longest_path)

    def ipath(at: Observation) -> jax.Array:
        return network_path(nav.planner.merge(), at, at.goal)

    def guidance_of(s: LoopState, at: Observation) -> Guidance:
        return guide(parameters, nav.planner.merge(), nav.intrinsics, s.sight.guide, at)[1]

    guidance = jax.jit(jax.vmap(guidance_of))(state, observation)

    def band(esdf: jax.Array, origin: jax.Array, way: Guidance) -> tuple:
        return safe_path(parameters.band, way.path - origin, esdf, memory_parameters.grid)

    def footsteps(s: LoopState, way: Guidance) -> Any:
        terms = rigid_body_terms(nav.walker.robot, s.walk.physics.qpos, s.walk.physics.qvel)
        zero, right = jnp.zeros(()), jnp.asarray(Side.RIGHT)
        stance = Stance(terms.com[:2], terms.com_velocity[:2], terms.foot_positions[0, :2], zero, right, zero)
        istepper = nav.planner.merge().istepper
        return plan_steps(nav.pursuit, istepper, way.path, way.face_point, stance, terms.com[:2])

    def think(c: Conditions, s: LoopState) -> Any:
        def tick(memory: Any, _: None) -> tuple[Any, None]:
            physics = s.walk.physics
            return sense_and_control(nav.walker, c, s.steps.plan, memory, physics.qpos, physics.qvel)[0], None

        return jax.lax.scan(tick, s.walk.memory, None, length=TICKS)[0]

    def walk(c: Conditions, s: LoopState) -> Any:
        plan = s.steps.plan
        return jax.lax.scan(lambda w, _: (walk_tick(nav.walker, c, plan, w)[0], None), s.walk, None, length=TICKS)[0]

    def clearance(task: TaskArrays, s: LoopState) -> jax.Array:
        return body_clearance_at(nav.walker.robot, nav.volume, task.scene, s.walk.physics.qpos)

    rendering = setting.time(render, tasks, state)
    thinking = setting.time(think, setting.conditions, state)
    walking = setting.time(walk, setting.conditions, state)
    return {
        "depth rendering": (rendering, frames),
        "depth noise": (max(setting.time(see, tasks, state) - rendering, 0.0), frames),
        "map and distance field": (setting.time(add_map, state, observation), frames),
        "route on the map": (setting.time(route, state, routes, origin, observation), frames),
        "iPath": (setting.time(ipath, cleaned), frames),
        "band off obstacles": (setting.time(band, esdf, origin, guidance), frames),
        "iStepper and course": (setting.time(footsteps, state, guidance), nav.loop.checks_per_frame * frames),
        "body clearance": (setting.time(clearance, tasks, state), nav.loop.checks_per_frame * frames),
        "sensors, estimator, control": (thinking / TICKS, 500.0),
        "physics": (max(walking - thinking, 0.0) / TICKS, 500.0),
    }


def part_figures(parts: dict[str, tuple[float, float]], title: str) -> Iterator[Fact]:
    """Microseconds a call, milliseconds a robot-second and share of each part, and their sum."""
    spent = {name: each * rate for name, (each, rate) in parts.items()}
    total = sum(spent.values())
    for name, (each, _) in parts.items():
        yield Fact(f"{title}, {name}", 1e3 * each, f"us a call, {spent[name] / total:.0%} of a second")
    yield Fact(f"{title}, all parts", 1e3 / total, "times real time on one device")


def latency(navigator: Navigator, planner: Planner) -> Group:
    """The networks and one control tick for one robot, called one by one."""
    config = planner.config
    mount = config.ipath.mount.as_array()[None]

    def ipath(network: Planner) -> Callable[[], Any]:
        camera = network.config.ipath.camera
        depth = jnp.full((1, camera.height, camera.width), 2.0)
        call = jax.jit(lambda split, image: split.merge().plan_path(image, jnp.ones((1, 2)), mount)[0])
        return partial(call, split_module(network), depth)

    controller = navigator.walker.controller
    setting = Setting(navigator, generated_tasks(1), warm=15)
    walk = jax.tree.map(lambda leaf: leaf[0], setting.state.walk)
    plan = jax.tree.map(lambda leaf: leaf[0], setting.state.steps.plan)

    def control(qpos: jax.Array, qvel: jax.Array) -> jax.Array:
        robot = navigator.walker.robot
        terms = rigid_body_terms(robot, qpos, qvel)
        arms = qpos[robot.arm_positions], qvel[robot.arm_velocities]
        return control_step(controller, terms, arms, walk.memory.touching, plan, walk.memory.controller)[0]

    path = jnp.stack([jnp.linspace(0, 2, 100), jnp.zeros(100)], axis=1)
    zero = jnp.zeros(())
    stance = Stance(jnp.zeros(2), jnp.zeros(2), jnp.asarray([0.0, 0.05]), zero, jnp.asarray(Side.LEFT), zero)

    @jax.jit
    def step(split: SplitModule[Planner], path: jax.Array) -> jax.Array:
        return plan_steps(navigator.pursuit, split.merge().istepper, path, path[-1], stance, jnp.zeros(2))[0].positions

    small, published = small_paper_preset().planner, paper_preset().planner
    calls: dict[str, Callable[[], Any]] = {
        "iPath (default)": ipath(planner),
        "iPath (paper, 90 x 160)": ipath(Planner(small, nnx.Rngs(0))),
        "iPath (paper, 360 x 640)": ipath(Planner(published, nnx.Rngs(0))),
        "iStepper and course": partial(step, navigator.planner, path),
        "rigid-body terms and control": partial(jax.jit(control), walk.physics.qpos, walk.physics.qvel),
    }
    rows = [Contender(name, "ours", call) for name, call in calls.items()]
    return contest("One robot, one call at a time", "a call", rows, REPEATS)


def generated(count: int, seconds: float) -> list[Task]:
    """Generated tasks of at most some seconds each."""
    return [dataclasses.replace(task, time_limit=seconds) for task in generated_tasks(count)]


def episodes(navigator: Navigator, count: int, seconds: float, devices: int | None) -> Iterator[Group | Fact]:
    """How fast one batch of episodes is walked."""
    program = EpisodeProgram(navigator, count, devices)
    record = program.run(generated(count, seconds))
    # An episode that has ended costs as much as the others of its batch until the last one ends.
    ends = np.max(record.time, axis=1)
    walked, computed = float(np.sum(ends)), float(count * np.max(ends))
    row = Row("ours", "ours", (program.run_seconds / walked,), program.compile_seconds)
    yield Group(f"{count} episodes of up to {seconds:g} s", "a robot-second walked", (row,))
    yield Fact(f"{count} episodes: robot-seconds computed", computed / program.run_seconds, "a second")


def study(navigator: Navigator, count: int, width: int, seconds: float, devices: int | None) -> Iterator[Group | Fact]:
    """How fast a study of several batches is walked: batch after batch, and in one run of all."""
    program = EpisodeProgram(navigator, width, devices)
    tasks = generated(count * width, seconds)
    batches = [TaskBatch(tasks[k * width : (k + 1) * width], seed=k) for k in range(count)]
    program.run(generated(1, 0.1))  # compiled before it is timed
    began = time.perf_counter()
    apart = [program.run(batch.tasks, batch.seed) for batch in batches]
    apart_seconds, began = time.perf_counter() - began, time.perf_counter()
    together = dict(program.run_batches(batches))
    together_seconds = time.perf_counter() - began
    pairs = [pair for number, record in enumerate(apart) for pair in zip(record, together[number], strict=True)]
    walked = float(sum(np.sum(np.max(record.time, axis=1)) for record in apart))
    rows = (
        Row("batch after batch", "ours", (apart_seconds / walked,)),
        Row("in one run", "ours", (together_seconds / walked,)),
    )
    yield Group(f"A study of {count} batches of {width} episodes of up to {seconds:g} s", "a robot-second walked", rows)
    same = sum(a.tobytes() == b.tobytes() for a, b in pairs)
    yield Fact("records equal in both ways", float(same), f"of {len(pairs)}")


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    planner = planner_of(config.run)[0]
    navigator = make_navigator("default", planner)
    count, seconds = (4, 5.0) if config.quick else (config.episodes, config.seconds)
    if not config.study:
        yield latency(navigator, planner)
        yield from part_figures(parts_of(Setting(navigator, generated_tasks(1))), "one robot")
        yield from part_figures(parts_of(Setting(navigator, generated_tasks(16))), "16 robots")
        yield from episodes(navigator, 1, seconds, 1)
        yield from episodes(navigator, count, seconds, config.devices)
    if config.study or not config.quick:
        yield from study(navigator, config.batches, count, seconds, config.devices)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)
