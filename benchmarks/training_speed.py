"""Training speed: whole steps beside the network alone, and the price of each part of a step.

Run with `python -m benchmarks.training_speed`. The peer is the same network's forward and backward pass alone, with a
loss that costs nothing; what a step takes beyond it and Adam is the price of the two lower-level optimisations, the map
costs and gathering the batch. Maps are made once before training, so their price is shown apart. `--paper` measures the
published set-up instead, on images of 90 x 160 and of 360 x 640, and says how long one pass and all passes through the
published number of frames take.
"""

import dataclasses
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
import optax
import tyro

from benchmarks.suite.alone import Options, present
from benchmarks.suite.contest import Contender, contest
from benchmarks.suite.figures import Fact, Group
from iwalker_jax.data.frame_set import DEPTH_UNIT, FrameSet
from iwalker_jax.data.sources import DataConfig, load_training_frames
from iwalker_jax.geometry import resample_by_arc_length
from iwalker_jax.optimization import initial_state_from_reference, solve_step_mpc, solve_unicycle
from iwalker_jax.planning import RobotState, pre_impact_planes
from iwalker_jax.training.batches import TrainingBatch, frame_order, gather_batch
from iwalker_jax.training.config import TrainConfig, paper_preset, small_paper_preset
from iwalker_jax.training.maps import TrainingData, frame_maps, prepare
from iwalker_jax.training.train_step import (
    initial_state,
    make_optimiser,
    make_train_step,
    planner_structure,
)

FRAMES = 64
PAPER_FRAMES = 16
STEPS = 100


@dataclass(frozen=True)
class Config(Options):
    """Time training steps and their parts.

    Attributes:
        paper: the published set-up instead.
        repeats: turns; 5 with --quick.
    """

    paper: bool = False
    repeats: int = 20


class WholeStep:
    """Training steps one after the other: every step takes the state of the one before."""

    def __init__(self, config: TrainConfig, data: TrainingData):
        optimiser = make_optimiser(config, config.total_steps(STEPS))
        self.config, self.data, self.number = config, data, 0
        self.state = initial_state(config, optimiser)
        self._step = make_train_step(config, optimiser)
        self.converged: list[float] = []

    def __call__(self) -> Any:
        index = frame_order(0, len(self.data.depth), self.config.batch_size, self.number)
        self.state, report = self._step(self.state, self.data, jnp.asarray(index))
        self.number += 1
        self.converged.append(float(report.converged))
        return self.state


class NetworkAndAdam:
    """The network's forward and backward pass and the optimiser, without any of the losses."""

    def __init__(self, config: TrainConfig, batch: TrainingBatch):
        optimiser = make_optimiser(config, config.total_steps(STEPS))
        state = initial_state(config, optimiser)
        self._carry = state.params, state.opt_state
        gradient = network_gradient(config)

        def step(carry: Any, batch: TrainingBatch) -> Any:
            params, opt_state = carry
            updates, opt_state = optimiser.update(gradient(params, batch)[1], opt_state, params)
            return optax.apply_updates(params, updates), opt_state

        self._step, self._batch = jax.jit(step, donate_argnums=0), batch

    def __call__(self) -> Any:
        self._carry = self._step(self._carry, self._batch)
        return self._carry


def network_gradient(config: TrainConfig) -> Callable:
    """(params, batch) -> ((loss, plan), gradient) of both networks under a trivial loss."""
    planner = planner_structure(config)

    def loss(params: Any, batch: TrainingBatch) -> tuple:
        plan = planner.with_params(params).merge()(batch.depth, batch.goal, batch.state, batch.mount)
        return jnp.sum(plan.path) + jnp.sum(plan.fear) + jnp.sum(plan.footsteps), plan

    return jax.value_and_grad(loss, has_aux=True)


def lower_levels(config: TrainConfig, batch: TrainingBatch, plan: Any) -> dict[str, Callable[[], Any]]:
    """Each MPC with the gradient of its tracking loss, on a plan of the untrained network."""
    models = config.models

    def path_tracking(path: jax.Array) -> jax.Array:
        reference = resample_by_arc_length(path, path.shape[0])
        start = initial_state_from_reference(reference)
        return jnp.sum((path - solve_unicycle(reference, start, models.unicycle, config.gradient).value.path) ** 2)

    def step_tracking(footsteps: jax.Array, state: RobotState) -> jax.Array:
        planes = pre_impact_planes(state, config.planner.hlip)
        best = solve_step_mpc(footsteps, planes, config.planner.hlip, config.planner.step_weights, config.gradient)
        return jnp.sum((footsteps - best.value.footsteps) ** 2)

    unicycle = jax.jit(jax.vmap(jax.value_and_grad(path_tracking)))
    steps = jax.jit(jax.vmap(jax.value_and_grad(step_tracking)))
    return {
        "unicycle MPC": lambda: unicycle(plan.path),
        "step MPC": lambda: steps(plan.footsteps, batch.state),
    }


def steps(name: str, config: TrainConfig, data: TrainingData, repeats: int) -> Iterator[Group | Fact]:
    """One configuration's steps, and their parts."""
    whole = WholeStep(config, data)
    index = jnp.asarray(frame_order(0, len(data.depth), config.batch_size, 0))
    gather = jax.jit(lambda i: gather_batch(data, i, jax.random.key(0), config.mirror, config.planner))
    batch = gather(index)
    network = jax.jit(network_gradient(config))
    params = jax.tree.map(jnp.array, whole.state.params)
    (_, plan), _ = network(params, batch)
    count, size = sum(leaf.size for leaf in jax.tree.leaves(params)), config.batch_size
    title = f"{name}, {count / 1e6:.1f} M parameters, batch {size}"
    rows = [
        Contender("ours, whole step", "ours", whole, size),
        Contender("ours, network and Adam", "ours", NetworkAndAdam(config, batch), size),
        Contender("network alone, forward and backward", "peer", lambda: network(params, batch), size),
    ]
    yield contest(title, "a frame", rows, repeats)
    rows = [Contender("gathering", "ours", lambda: gather(index), size)]
    for part, call in lower_levels(config, batch, plan).items():
        rows.append(Contender(f"{part} and its gradient", "ours", call, size))
    yield contest(f"{title}, parts of a step", "a frame", rows, repeats)
    yield Fact(f"{name}, batch {size}: rows converged", 100 * float(np.mean(whole.converged)), "%")


def paper_steps(repeats: int) -> Iterator[Group | Fact]:
    """The published set-up at both image sizes, and what its passes take."""
    for config in (small_paper_preset(), paper_preset()):
        camera = config.planner.ipath.camera
        frames = load_training_frames(DataConfig(frames=PAPER_FRAMES), camera)
        data = prepare(frames, config.models.traversal, batch=PAPER_FRAMES)
        name = f"published set-up, {camera.height} x {camera.width}"
        for figure in steps(name, config, data, repeats):
            yield figure
            if isinstance(figure, Group) and figure.fastest_peer() is not None:
                seconds = config.source.frames * figure.rows[0].median  # of whole steps
                yield Fact(f"{name}: a pass of {config.source.frames} frames", seconds / 60, "min")
                yield Fact(f"{name}: {config.epochs} passes", config.epochs * seconds / 3600, "h")


def maps(config: TrainConfig, frames: FrameSet, repeats: int) -> Group:
    """What making the maps of a frame costs, once before training."""
    camera, traversal, size = config.planner.ipath.camera, config.models.traversal, 16
    many = jax.jit(
        jax.vmap(lambda depth, mount, goals: frame_maps(depth * DEPTH_UNIT, mount, goals, camera, traversal))
    )
    depth = jnp.asarray(frames.depth[:size], jnp.float32)
    mounts, goals = jnp.asarray(frames.mounts[:size]), jnp.asarray(frames.goals[:size])
    row = Contender("ours", "ours", partial(many, depth, mounts, goals), size)
    return contest(f"maps of a frame for {goals.shape[1]} goals, made once before training", "a frame", [row], repeats)


def measure(config: Config) -> Iterator[Group | Fact]:
    """All figures of this benchmark."""
    training = TrainConfig()
    repeats = min(config.repeats, 5) if config.quick else config.repeats
    if config.paper:
        yield from paper_steps(repeats)
        return
    frames = load_training_frames(DataConfig(frames=FRAMES), training.planner.ipath.camera)
    yield maps(training, frames, min(repeats, 5))
    data = prepare(frames, training.models.traversal)
    for size in (16,) if config.quick else (1, 16):
        yield from steps("default preset", dataclasses.replace(training, batch_size=size), data, repeats)


if __name__ == "__main__":
    options = tyro.cli(Config, description=__doc__)
    present(measure(options), options)
