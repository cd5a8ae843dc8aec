"""Evaluation results made by hand, for the tests of tables and pictures."""

import numpy as np

from iwalker_jax.data.frame_set import FrameSet
from iwalker_jax.evaluation.frames.metrics import PlanMetrics, TrueMetrics
from iwalker_jax.evaluation.frames.sequences import FrameSequence, SequenceResult
from iwalker_jax.perception import Intrinsics
from iwalker_jax.perception.grid import DEFAULT_GRID, PUBLISHED_GRID
from iwalker_jax.perception.local_map import LocalMap


def make_result(truth: bool = True, frames: int = 4, name: str = "office") -> SequenceResult:
    """Paths straight ahead beside a block; of every second frame the goal is in view, the first is not served."""
    n = frames
    path = np.stack([np.linspace(0, 3, 100), np.zeros(100)], axis=1)
    steps = np.stack([np.linspace(0.1, 2, 20), 0.045 * (-1.0) ** np.arange(20)], axis=1)
    occupied = np.zeros((n, *DEFAULT_GRID.shape), bool)
    occupied[:, 50:70, 90:110] = True
    unknown = np.zeros_like(occupied)
    unknown[:, 70:, 90:110] = True
    esdf = np.where(occupied, -0.2, 0.8)
    counting = np.arange(n, dtype=float)
    in_view = np.arange(n) % 2 == 0
    served = np.arange(n) > 0
    return SequenceResult(
        name=name,
        goals=np.tile([4.0, 0.5], (n, 1)),
        path=np.tile(path, (n, 1, 1)),
        tracked=np.tile(path + np.array([0.0, 0.3]), (n, 1, 1)),
        footsteps=np.tile(steps, (n, 1, 1)),
        fear=np.linspace(0.1, 0.9, n),
        stance_sign=np.where(in_view, 1.0, -1.0),
        plan=PlanMetrics(counting, 2 * counting, 3 * counting, 10 + counting, 0.5 * counting),
        truth=TrueMetrics(
            path_collides=~served,
            footsteps_in_collision=0.1 * counting,
            path_in_collision=0.0 * counting,
            goal_distance=counting,
            progress=counting,
            remaining=counting,
            efficiency=0.0 * counting + 0.9,
        )
        if truth
        else None,
        in_view=in_view if truth else None,
        served=served if truth else None,
        maps=LocalMap(occupied, ~occupied & ~unknown, unknown, esdf, np.zeros((n, *PUBLISHED_GRID.shape))),
    )


def make_sequence(frames: int = 4, name: str = "office") -> FrameSequence:
    """Depth images of a ramp, the frames of `make_result`."""
    depth = np.tile(np.linspace(0, 5000, 90).astype(np.uint16)[:, None], (frames, 1, 160))
    zeros = np.zeros((frames, 5), np.float32)
    goals = np.tile(np.float32([4.0, 0.5]), (frames, 1, 1))
    scenes = np.zeros(frames, np.int32)
    return FrameSequence(name, FrameSet(depth, zeros, goals, zeros[:, :3], scenes, (name,), Intrinsics()), None)
