"""Training a planner: configuration, maps, losses, the train step and loop, checkpoints and the shipped planner."""

from iwalker_jax.training.checkpoints import CheckpointStore, load_run
from iwalker_jax.training.config import PRESETS, TrainConfig, paper_preset, quick_preset, small_paper_preset
from iwalker_jax.training.loop import TrainingProgress, TrainResult, batch_mesh, train
from iwalker_jax.training.losses import LossWeights, path_losses, step_losses
from iwalker_jax.training.maps import TrainingData, prepare
from iwalker_jax.training.ppo import PpoSettings
from iwalker_jax.training.pretrained import load_planner, save_planner
from iwalker_jax.training.run_log import read_metrics
from iwalker_jax.training.train_step import (
    StepReport,
    TrainState,
    initial_state,
    make_optimiser,
    make_planner,
    make_train_step,
    planner_from,
)
from iwalker_jax.training.whole_body_losses import ControlledRobot, load_controlled_robot, whole_body_losses

__all__ = [
    "PRESETS",
    "CheckpointStore",
    "ControlledRobot",
    "LossWeights",
    "PpoSettings",
    "StepReport",
    "TrainConfig",
    "TrainResult",
    "TrainState",
    "TrainingData",
    "TrainingProgress",
    "batch_mesh",
    "initial_state",
    "load_controlled_robot",
    "load_planner",
    "load_run",
    "make_optimiser",
    "make_planner",
    "make_train_step",
    "paper_preset",
    "path_losses",
    "planner_from",
    "prepare",
    "quick_preset",
    "read_metrics",
    "save_planner",
    "small_paper_preset",
    "step_losses",
    "train",
    "whole_body_losses",
]
