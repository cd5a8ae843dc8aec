"""Probes of the configurations of data, planner and training."""

import dataclasses
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from iwalker_jax.data import sources
from iwalker_jax.data.camera_path import record_camera_path
from iwalker_jax.data.frame_set import FrameSet
from iwalker_jax.data.path_sampling import CameraPathSampling
from iwalker_jax.data.sources import DataConfig, cache_file, load_training_frames
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID
from iwalker_jax.perception.seen_route import ROUTE_GRID
from iwalker_jax.planning.models import PlannerModels
from iwalker_jax.planning.planner import Planner, PlannerConfig
from iwalker_jax.planning.robot_state import sample_robot_state
from iwalker_jax.training import loop
from iwalker_jax.training.baselines import HeuristicWeights, heuristic_losses, heuristic_sum
from iwalker_jax.training.batches import TrainingBatch, frame_order, gather_batch
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.losses import LossWeights, PathLosses, StepLosses, path_losses, step_losses, weighted_sum
from iwalker_jax.training.maps import FrameMaps, TrainingData
from iwalker_jax.training.objectives import batch_losses, explore
from iwalker_jax.training.ppo import ActorCritic, Experience, PpoSettings, ppo_losses, ppo_sum
from iwalker_jax.training.train_step import StepReport, initial_state, make_optimiser, make_planner
from iwalker_jax.training.whole_body_losses import WholeBodyLosses
from tests.settings.mechanism import Probe
from tests.settings.robot_probes import ROOM
from tests.settings.small_probes import LIGHT, MOUNT, PATH, SMALL, STATE, depth_image, one_row

TINY = TrainConfig(planner=PlannerConfig(ipath=LIGHT), batch_size=2)
HALF = ROUTE_GRID.shape
STEPS = jnp.zeros((20, 2))


def maps(rows: tuple[int, ...] = ()) -> FrameMaps:
    """Maps of anything."""
    return FrameMaps(
        jnp.ones((*rows, *DEFAULT_GRID.shape)),
        jnp.ones((*rows, *HALF)),
        jnp.ones((*rows, *HALF)),
        jnp.ones((*rows, 40, 2)),
        jnp.ones((*rows, *PUBLISHED_GRID.shape)),
    )


@cache
def batch() -> TrainingBatch:
    """A batch of one."""
    return TrainingBatch(depth_image()[None], jnp.ones((1, 2)), MOUNT[None], one_row(STATE), maps((1,)))


@cache
def data() -> TrainingData:
    """Three frames."""
    n = 3
    whole = maps((n,))
    routes = jnp.ones((n, 1, 40, 2))
    depth = jnp.ones((n, SMALL.height, SMALL.width), jnp.uint16)
    return TrainingData(
        depth, jnp.tile(MOUNT, (n, 1)), jnp.ones((n, 1, 2)), whole.esdf, whole.unknown, whole.to_go[:, None], routes,
        whole.published,
    )  # fmt: skip


def prepare() -> None:
    """Make what probes share before any of them is traced."""
    batch(), data()


def step_of(config: TrainConfig) -> Any:
    """Losses of a batch and U_step's derivative."""
    planner = Planner(config.planner, nnx.Rngs(0))
    return batch_losses(planner, batch(), config)[:1]


def descended(config: TrainConfig) -> Any:
    """The last of six updates of the optimiser, on a schedule of few steps."""
    params = {"a": jnp.ones(3)}
    optimiser = make_optimiser(config, config.total_steps(40))
    state, updates = optimiser.init(params), params
    for size in (1.0, 1.0, 1.0, 1.0, 1.0, 100.0):
        updates, state = optimiser.update({"a": jnp.full(3, size)}, state, params)
    return updates


def begun(config: TrainConfig) -> Any:
    """The first update of the optimiser."""
    params = {"a": jnp.ones(3)}
    optimiser = make_optimiser(config, 40)
    return optimiser.update(params, optimiser.init(params), params)[0]


def checkpointed(config: TrainConfig) -> Any:
    """Steps whose checkpoints are left by a run of eight steps that does nothing, and the steps at which it saved."""
    saved: list[int] = []

    def idle_step(*_: Any) -> Any:
        zero = jnp.zeros(())
        return lambda state, data, index: (
            state._replace(step=state.step + 1), StepReport({"total": zero}, zero, zero, jnp.asarray(True)),
        )  # fmt: skip

    config = dataclasses.replace(config, batch_size=1, epochs=3)
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "make_train_step", idle_step)
        patch.setattr(loop, "starting_state", lambda *_: _small_state())
        patch.setattr(loop.CheckpointStore, "save", _noting(saved, loop.CheckpointStore.save))
        loop.train(config, data(), Path(folder), say=lambda _: None)
        left = sorted(int(entry.name) for entry in (Path(folder) / "checkpoints").glob("[0-9]*"))
    return saved, left


def _small_state() -> Any:
    state = initial_state(TINY, make_optimiser(TINY, 10))
    return state._replace(params=jnp.ones(1), opt_state=jnp.ones(1))


def _noting(saved: list[int], save: Any) -> Any:
    def noting(store: Any, state: Any, *arguments: Any) -> None:
        saved.append(int(state.step))
        save(store, state, *arguments)

    return noting


def policy_of(settings: PpoSettings) -> Any:
    """What PPO does before it takes a gradient: the learner, what it tries, and its objective."""
    learner = ActorCritic(TINY.planner, settings, nnx.Rngs(0))
    config = dataclasses.replace(TINY, method="ppo", ppo=settings)
    tried, _ = explore(learner, batch(), jax.random.key(0), config)
    return learner.log_deviation[...], tried


def objective_of(settings: PpoSettings) -> Any:
    """PPO's objective."""
    tried = Experience(jnp.ones((2, 3, 5, 2)), jnp.ones((2, 3)), jnp.ones((2, 3)), jnp.ones((2, 3)))
    losses = ppo_losses(jnp.zeros((3, 5, 2)), jnp.zeros((5, 2)), jnp.zeros(3), tried, settings)
    return losses, ppo_sum(losses, settings)


def scenes_of(source: DataConfig) -> Any:
    """Names of the scenes that frames come from, with stubs for everything that makes frames."""

    def frames(name: str) -> FrameSet:
        depth, rows = np.ones((1, SMALL.height, SMALL.width), np.uint16), np.zeros((1, 5), np.float32)
        return FrameSet(depth, rows, np.ones((1, 1, 2), np.float32), rows[:, :3], np.zeros(1, np.int32), (name,), SMALL)

    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setenv("IWALKER_CACHE", folder)
        patch.setattr(sources, "generate_training_frames", lambda *_, **__: frames("generated"))
        patch.setattr(sources, "frames_from_recording", lambda *_, topic, **__: frames(f"recorded {topic}"))
        patch.setattr(sources, "load_frames", lambda file: frames("episodes"))
        return load_training_frames(source, SMALL, say=lambda _: None).scene_names


def sampled_path(sampling: CameraPathSampling) -> Any:
    """Frames along a path through an empty room."""
    frames = record_camera_path(ROOM, 3, sampling, SMALL, noise=None)
    return None if frames is None else (frames.goals, frames.mounts, frames.poses)


PROBES = {
    DataConfig: (
        Probe(lambda c: str(cache_file(c, SMALL)), DataConfig(), traced=False, only=("frames", "seed")),
        Probe(
            scenes_of,
            DataConfig(),
            changes={"folder": Path("recording"), "episodes": Path("episodes.npz")},
            traced=False,
            only=("folder", "episodes"),
        ),
        Probe(
            scenes_of, DataConfig(folder=Path("recording")), changes={"topic": "/depth"}, traced=False, only=("topic",)
        ),
    ),
    CameraPathSampling: (
        Probe(
            sampled_path,
            CameraPathSampling(frames_per_path=3, goals_per_frame=2, min_route=1.0, last_frame=0.5),
            changes={"max_route": 1.3, "min_clearance": 3.0},
            traced=False,
        ),
    ),
    PlannerConfig: (
        Probe(
            lambda c: (
                Planner(c, nnx.Rngs(0))(depth_image()[None], jnp.ones((1, 2)), one_row(STATE)),
                sample_robot_state(jax.random.key(0), c.steps, c.hlip),
                step_losses(jnp.zeros((c.steps.count, 2)), PATH, STATE, maps(), c, PlannerModels(), "stopped"),
            ),
            TINY.planner,
        ),
    ),
    PlannerModels: (
        Probe(
            lambda c: (
                path_losses(PATH, jnp.zeros(()), maps(), c, "stopped"),
                step_losses(STEPS, PATH, STATE, maps(), PlannerConfig(), c, "stopped"),
            ),
            PlannerModels(),
        ),
    ),
    LossWeights: (
        Probe(
            lambda c: [
                weighted_sum(terms(*jnp.ones(len(terms._fields))), c)
                for terms in (PathLosses, StepLosses, WholeBodyLosses)
            ],
            LossWeights(),
            only=tuple(f.name for f in dataclasses.fields(LossWeights) if f.name != "step_to_path"),
        ),
        Probe(
            lambda c: step_of(dataclasses.replace(TINY, weights=c)),
            LossWeights(),
            only=("step_to_path",),
        ),
    ),
    HeuristicWeights: (
        Probe(
            lambda c: heuristic_sum(heuristic_losses(PATH, jnp.ones(()), jnp.ones(2), maps(), c), c),
            HeuristicWeights(),
        ),
    ),
    PpoSettings: (
        Probe(policy_of, PpoSettings(), followed=False, only=("samples", "deviation", "worst_return")),
        Probe(objective_of, PpoSettings(), only=("clip", "entropy", "value")),
        Probe(
            lambda c: dataclasses.replace(TINY, method="ppo", ppo=c).updates_per_step,
            PpoSettings(),
            traced=False,
            only=("epochs",),
        ),
    ),
    TrainConfig: (
        Probe(
            step_of,
            TINY,
            changes={"method": "iplanner", "gradient": "unrolled"},
            only=("method", "gradient", "models", "weights"),
        ),
        Probe(lambda c: jax.tree.leaves(nnx.state(make_planner(c))), TINY, traced=False, only=("planner", "seed")),
        Probe(
            descended,
            dataclasses.replace(TINY, batch_size=20, epochs=2),
            traced=False,
            only=("batch_size", "epochs", "learning_rate", "final_learning_rate", "clip"),
        ),
        Probe(begun, TINY, changes={"warm_up": 0}, traced=False, only=("warm_up",)),
        Probe(
            lambda c: gather_batch(data(), jnp.arange(2), jax.random.key(0), c.mirror, c.planner),
            TINY,
            only=("mirror",),
        ),
        Probe(lambda c: frame_order(c.seed, 9, c.batch_size, 0), TINY, traced=False, only=("seed", "batch_size")),
        Probe(
            lambda c: dataclasses.replace(c, method="ppo").updates_per_step,
            TINY,
            changes={"ppo": PpoSettings(epochs=7)},
            traced=False,
            only=("ppo",),
        ),
        Probe(
            lambda c: str(cache_file(c.source, c.planner.ipath.camera)),
            TINY,
            changes={"source": DataConfig(seed=5)},
            traced=False,
            only=("source",),
        ),
        Probe(
            checkpointed,
            dataclasses.replace(TINY, checkpoint_every=2),
            traced=False,
            only=("checkpoint_every", "keep_checkpoints"),
        ),
    ),
}
