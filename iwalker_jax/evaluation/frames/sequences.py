"""Evaluation on frames: the four test sequences and unseen generated scenes, planned in batches, scored row by row."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key

from iwalker_jax.data import CameraPathSampling, FrameSet, concatenate, record_camera_path
from iwalker_jax.errors import InputError
from iwalker_jax.evaluation.frames.metrics import (
    PlanMetrics,
    TrueMetrics,
    goal_in_view,
    goal_served,
    plan_metrics,
    true_metrics,
)
from iwalker_jax.evaluation.frames.reference_plans import ReferencePlanner
from iwalker_jax.geometry import to_world
from iwalker_jax.perception import Intrinsics, LocalMap, build_local_map
from iwalker_jax.planning import (
    Plan,
    Planner,
    PlannerConfig,
    PlannerModels,
    SplitModule,
    sample_robot_state,
    split_module,
)
from iwalker_jax.scenes import (
    SEQUENCE_NAMES,
    RouteMap,
    Scene,
    SceneArrays,
    held_out_scene,
    held_out_sequence,
    shortest_distance,
)
from iwalker_jax.streams import SEQUENCE_PATHS, UNSEEN_LAYOUTS, UNSEEN_PATHS

_BATCH = 16


class FrameSequence(NamedTuple):
    """Frames to evaluate on and the scenes they were taken in (None for real recordings)."""

    name: str
    frames: FrameSet
    scenes: tuple[Scene, ...] | None


@dataclass(frozen=True, eq=False)
class SequenceResult:
    """Plans and metrics of every frame of a sequence; arrays have a leading frame axis, NumPy.

    Attributes:
        name: of the sequence.
        goals: (n, 2) [m] the goals asked for.
        path, tracked: (n, 100, 2) [m] before and after the unicycle MPC.
        footsteps: (n, m, 2) [m].
        fear: (n,) predicted probability of an obstacle on the path.
        stance_sign: (n,) `side_sign` of the stance foot.
        plan: the paper's metrics.
        truth: ground-truth metrics; None for real recordings.
        in_view: (n,) whether the goal is in view; None for real recordings.
        served: (n,) whether the plan serves its goal; None for real recordings.
        maps: local maps of the frames.
    """

    name: str
    goals: Float[np.ndarray, "n 2"]
    path: Float[np.ndarray, "n p 2"]
    tracked: Float[np.ndarray, "n p 2"]
    footsteps: Float[np.ndarray, "n m 2"]
    fear: Float[np.ndarray, " n"]
    stance_sign: Float[np.ndarray, " n"]
    plan: PlanMetrics
    truth: TrueMetrics | None
    in_view: Bool[np.ndarray, " n"] | None
    served: Bool[np.ndarray, " n"] | None
    maps: LocalMap


def record_held_out_sequence(
    name: str, frames: int = 60, seed: int = 0, camera: Intrinsics = Intrinsics()
) -> FrameSequence:
    """The named test sequence (stair, office, corridor, corner): noisy frames along its route, goal at its end."""
    if name not in SEQUENCE_NAMES:
        raise InputError(f"Unknown test scene {name!r}; choose one of {', '.join(SEQUENCE_NAMES)}.")
    sequence = held_out_sequence(name)
    sampling = CameraPathSampling(frames_per_path=frames)
    path = record_camera_path(
        sequence.scene, SEQUENCE_PATHS.number(seed), sampling, camera, route=np.asarray(sequence.route)
    )
    if path is None:
        raise InputError(f"The route of test scene {name!r} does not fit the robot.")
    return FrameSequence(name, path, (sequence.scene,))


def record_unseen_scenes(
    scenes: int = 60,
    frames_per_scene: int = 5,
    seed: int = 0,
    on_progress: Callable[[int], None] = lambda done: None,
    camera: Intrinsics = Intrinsics(),
) -> FrameSequence:
    """Camera paths through scenes of the held-out generator, which no training seed can produce."""
    parts: list[FrameSet] = []
    kept: list[Scene] = []
    sampling = CameraPathSampling(frames_per_path=frames_per_scene)
    number = 0
    while len(parts) < scenes:
        scene = held_out_scene(UNSEEN_LAYOUTS.number(seed, number))
        path = record_camera_path(scene, UNSEEN_PATHS.number(seed, number), sampling, camera)
        number += 1
        if path is not None:
            parts.append(path)
            kept.append(scene)
            on_progress(len(parts))
    return FrameSequence("unseen", concatenate(parts), tuple(kept))


def evaluate_sequence(
    planner: Planner | ReferencePlanner,
    models: PlannerModels,
    sequence: FrameSequence,
    goal_index: int = 0,
    seed: int = 0,
    routes: Sequence[RouteMap] | None = None,
) -> SequenceResult:
    """Plan every frame of a sequence and score it.

    Args:
        planner: with trained parameters, or plans by a rule.
        models: of the two MPCs and the body.
        sequence: frames and scenes.
        goal_index: which of each frame's goals to ask for; 0 is the route's end, as in the paper.
        seed: of the robot states that iStepper sees.
        routes: of the sequence's goals (`goal_routes`), for whoever scores several planners on it; found anew if left
            out.

    Raises:
        InputError: if the frames were seen through another camera than the planner's.
    """
    frames, camera = sequence.frames, planner.config.ipath.camera
    if frames.camera != camera:
        raise InputError(
            f"The frames of {sequence.name} were seen through {frames.camera}, but the planner's camera is {camera}; "
            "record them through the planner's camera."
        )
    n = len(frames)
    depth = frames.depth_metres()
    goals = frames.goals[:, goal_index]

    # Parameters are arguments, so that one compiled program serves every sequence, checkpoint and seed.
    plans_by = split_module(planner) if isinstance(planner, Planner) else planner
    keys = jax.random.split(jax.random.key(seed), n)
    parts: list[Any] = []
    for start in range(0, n, _BATCH):
        index = np.minimum(np.arange(start, start + _BATCH), n - 1)
        batch = (jnp.asarray(depth[index]), frames.mounts[index], goals[index], keys[index])
        out = _plan_batch(plans_by, *batch, planner.config, models)
        parts.append(jax.tree.map(lambda x, keep=min(_BATCH, n - start): np.asarray(x[:keep]), out))
    plan, tracked, metrics, side, maps = jax.tree.map(lambda *x: np.concatenate(x), *parts)

    truth = in_view = served = None
    if sequence.scenes is not None:
        found = goal_routes(sequence, goal_index) if routes is None else routes
        truth, in_view = _truth(frames, sequence.scenes, goals, plan.path, plan.footsteps, models, found)
        served = np.asarray(goal_served(truth, jnp.asarray(in_view)))
    return SequenceResult(
        name=sequence.name,
        goals=goals,
        path=plan.path,
        tracked=tracked,
        footsteps=plan.footsteps,
        fear=1.0 / (1.0 + np.exp(-plan.fear)),
        stance_sign=side,
        plan=metrics,
        truth=truth,
        in_view=in_view,
        served=served,
        maps=maps,
    )


def goal_routes(sequence: FrameSequence, goal_index: int = 0) -> list[RouteMap]:
    """Shortest distances to the goal of every frame, by ground truth; they take most of the time of scoring a plan.

    Args:
        sequence: with its scenes.
        goal_index: which of each frame's goals.

    Raises:
        InputError: for a sequence without ground truth.
    """
    if sequence.scenes is None:
        raise InputError(f"Nobody knows the scene of {sequence.name}; there are no true routes in it.")
    frames, arrays = sequence.frames, [scene.arrays() for scene in sequence.scenes]
    goals = jnp.asarray(frames.goals[:, goal_index])
    poses = jnp.asarray(frames.poses)
    return [_route(arrays[frames.scene_index[i]], poses[i], goals[i]) for i in range(len(goals))]


@jax.jit
def _route(scene: SceneArrays, pose: Float[Array, "3"], goal: Float[Array, "2"]) -> RouteMap:
    return shortest_distance(scene, to_world(pose, goal))


@functools.partial(jax.jit, static_argnames=("config", "models"))
def _plan_batch(
    plans_by: SplitModule[Planner] | ReferencePlanner,
    depth: Float[Array, "n height width"],
    mounts: Float[Array, "n 5"],
    goals: Float[Array, "n 2"],
    keys: Key[Array, " n"],
    config: PlannerConfig,
    models: PlannerModels,
) -> tuple[Plan, Float[Array, "n p 2"], PlanMetrics, Float[Array, " n"], LocalMap]:
    """Plans of frames, by the network or by the rule, their paths after the unicycle MPC, what they are worth, the
    stance feet and the local maps."""
    maps = jax.vmap(lambda d, m: build_local_map(d, m, config.ipath.camera))(depth, mounts)
    state = jax.vmap(lambda key: sample_robot_state(key, config.steps, config.hlip))(keys)
    if isinstance(plans_by, ReferencePlanner):
        plan = plans_by(goals, state)
    else:
        plan = plans_by.merge()(depth, goals, state, mounts)
    score = jax.vmap(lambda p, w, s, x, m: plan_metrics(p, w, s, x, m, config, models))
    metrics, tracked = score(plan.path, plan.waypoints, plan.footsteps, state, maps.published)
    return plan, tracked, metrics, state.stance_sign, maps


def _truth(
    frames: FrameSet,
    scenes: tuple[Scene, ...],
    goals: Float[np.ndarray, "n 2"],
    paths: Float[np.ndarray, "n p 2"],
    footsteps: Float[np.ndarray, "n m 2"],
    models: PlannerModels,
    routes: Sequence[RouteMap],
) -> tuple[TrueMetrics, Bool[np.ndarray, " n"]]:
    """Ground truth of every frame's plan, frame axis first, and whether its goal is in view."""
    half_view = float(np.arctan2(frames.camera.width / 2, frames.camera.fx))
    rows, views = [], []
    arrays = [scene.arrays() for scene in scenes]
    for i in range(len(goals)):
        truth, view = _score_truth(
            arrays[frames.scene_index[i]],
            jnp.asarray(frames.poses[i]),
            jnp.asarray(goals[i]),
            jnp.asarray(paths[i]),
            jnp.asarray(footsteps[i]),
            models.traversal.body_radius,
            half_view,
            routes[i],
        )
        rows.append(truth)
        views.append(view)
    return jax.tree.map(lambda *x: np.stack([np.asarray(v) for v in x]), *rows), np.asarray(views)


@jax.jit
def _score_truth(
    scene: SceneArrays,
    pose: Float[Array, " 3"],
    goal: Float[Array, " 2"],
    path: Float[Array, "p 2"],
    footsteps: Float[Array, "m 2"],
    body_radius: float | Float[Array, ""],
    half_view: float | Float[Array, ""],
    shortest: RouteMap,
) -> tuple[TrueMetrics, Bool[Array, ""]]:
    """Ground truth of one plan, and whether its goal is in view."""
    truth = true_metrics(path, footsteps, goal, pose, scene, shortest, body_radius)
    return truth, goal_in_view(goal, pose, scene, half_view, range_limit=6.0)
