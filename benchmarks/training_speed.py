"""Training speed: frames a second of whole steps and the price of each part (`python -m benchmarks.training_speed`).

The peer is the same network's forward and backward pass alone, with a loss that costs nothing; what a step takes beyond
it and Adam is the price of the two lower-level optimisations, the map costs and gathering the batch. Maps are made once
before training, so their price is shown apart. `--paper` measures the published set-up instead, on images of 90 x 160
and of 360 x 640, and says how long one pass and all passes through the published number of frames take.
"""

import argparse
import dataclasses
from collections.abc import Callable
from typing import Any

from iwalker_jax.runtime.settings import configure_runtime

configure_runtime()

import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import optax  # noqa: E402

from benchmarks.timing import in_turns, timed  # noqa: E402
from iwalker_jax.data.frame_set import DEPTH_UNIT, FrameSet  # noqa: E402
from iwalker_jax.data.sources import DataConfig, load_training_frames  # noqa: E402
from iwalker_jax.geometry import resample_by_arc_length  # noqa: E402
from iwalker_jax.optimization import initial_state_from_reference, solve_step_mpc, solve_unicycle  # noqa: E402
from iwalker_jax.planning import RobotState, pre_impact_planes  # noqa: E402
from iwalker_jax.runtime.devices import machine  # noqa: E402
from iwalker_jax.training.batches import TrainingBatch, frame_order, gather_batch  # noqa: E402
from iwalker_jax.training.config import TrainConfig, paper_preset, small_paper_preset  # noqa: E402
from iwalker_jax.training.maps import TrainingData, frame_maps, prepare  # noqa: E402
from iwalker_jax.training.train_step import (  # noqa: E402
    initial_state,
    make_optimiser,
    make_train_step,
    planner_structure,
)

FRAMES = 64
PAPER_FRAMES = 16
STEPS = 100


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


def measure(name: str, config: TrainConfig, data: TrainingData, repeats: int) -> float:
    """Print one configuration's speed and the parts of its step; returns the median frames a second."""
    whole = WholeStep(config, data)
    index = jnp.asarray(frame_order(0, len(data.depth), config.batch_size, 0))
    gather = jax.jit(lambda i: gather_batch(data, i, jax.random.key(0), config.mirror, config.planner))
    batch = gather(index)
    network = jax.jit(network_gradient(config))
    params = jax.tree.map(jnp.array, whole.state.params)
    (_, plan), _ = network(params, batch)
    calls: dict[str, Callable[[], Any]] = {
        "whole step": whole,
        "network alone": lambda: network(params, batch),
        "network, Adam": NetworkAndAdam(config, batch),
        "gather": lambda: gather(index),
        **lower_levels(config, batch, plan),
    }
    times = in_turns(calls, repeats)
    compiled = sum(part.first for part in times.values())
    count = sum(leaf.size for leaf in jax.tree.leaves(params))
    print(
        f"\n{name}, {count / 1e6:.1f} M parameters, batch {config.batch_size}: {compiled:.0f} s of compilation, "
        f"{np.mean(whole.converged):.0%} of rows converged"
    )
    print(f"  {'part':<16} {'min ms':>8} {'median ms':>10} {'of the step':>12}")
    full = times["whole step"]
    for part, (_, best, median) in times.items():
        print(f"  {part:<16} {1e3 * best:8.1f} {1e3 * median:10.1f} {best / full.best:12.0%}")
    rest = 1 - times["network, Adam"].best / full.best
    slower = full.best / times["network alone"].best
    print(f"  MPCs, losses and gathering: {rest:.0%} of the step; the step is {slower:.2f} x the network alone (peer)")
    step = full.each(config.batch_size)
    print(f"  {1 / step.best:.2f} frames/s at best, {1 / step.median:.2f} median")
    return 1 / step.median


def measure_paper(repeats: int) -> None:
    """Print the published set-up's speed at both image sizes, and what its passes take."""
    for config in (small_paper_preset(), paper_preset()):
        camera = config.planner.ipath.camera
        frames = load_training_frames(DataConfig(frames=PAPER_FRAMES), camera)
        data = prepare(frames, config.models.traversal, batch=PAPER_FRAMES)
        rate = measure(f"published set-up, {camera.height} x {camera.width}", config, data, repeats)
        seconds = config.source.frames / rate
        print(
            f"  a pass of {config.source.frames} frames takes {seconds / 60:.1f} min, {config.epochs} passes "
            f"{config.epochs * seconds / 3600:.1f} h"
        )


def measure_maps(config: TrainConfig, frames: FrameSet, repeats: int) -> None:
    """Print what making the maps of a frame costs, once before training."""
    camera, traversal, size = config.planner.ipath.camera, config.models.traversal, 16
    many = jax.jit(
        jax.vmap(lambda depth, mount, goals: frame_maps(depth * DEPTH_UNIT, mount, goals, camera, traversal))
    )
    depth = jnp.asarray(frames.depth[:size], jnp.float32)
    mounts, goals = jnp.asarray(frames.mounts[:size]), jnp.asarray(frames.goals[:size])
    times = timed(many, depth, mounts, goals, repeats=repeats)
    best, median = 1e3 * times.each(size).best, 1e3 * times.each(size).median
    print(
        f"maps of a frame, {goals.shape[1]} goals, made once: {best:.1f} ms min, {median:.1f} ms "
        f"median ({times.first:.0f} s of compilation); {best / config.epochs:.2f} ms a frame and epoch over "
        f"{config.epochs} epochs, instead of {best:.1f} ms if every step made them anew"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--paper", action="store_true", help="the published set-up instead")
    parser.add_argument("--repeats", type=int, default=20, help="timed rounds")
    arguments = parser.parse_args()
    config = TrainConfig()
    print(f"{machine()}; best and median of {arguments.repeats}")
    if arguments.paper:
        measure_paper(arguments.repeats)
        return
    frames = load_training_frames(DataConfig(frames=FRAMES), config.planner.ipath.camera)
    measure_maps(config, frames, min(arguments.repeats, 5))
    data = prepare(frames, config.models.traversal)
    for size in (1, 16):
        measure("default preset", dataclasses.replace(config, batch_size=size), data, arguments.repeats)


if __name__ == "__main__":
    main()
