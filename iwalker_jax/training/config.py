"""Training configuration: one frozen dataclass, saved with every checkpoint, and its presets."""

import dataclasses
import typing
from dataclasses import dataclass
from typing import Literal

from iwalker_jax.checks import require_plain_numbers
from iwalker_jax.data.sources import DataConfig
from iwalker_jax.errors import InputError
from iwalker_jax.optimization import GradientMode, StepMpcWeights, UnicycleParameters
from iwalker_jax.perception import Intrinsics
from iwalker_jax.planning import IPathConfig, IStepperConfig, PlannerConfig, PlannerModels, StepGeometry
from iwalker_jax.streams import check_seed
from iwalker_jax.training.losses import LossWeights
from iwalker_jax.training.ppo import PpoSettings

Method = Literal["iwalker", "iplanner", "finetuned", "ppo"]
"""iwalker: both bilevel losses. iplanner: heuristic path losses. finetuned: heuristic path losses and U_path's
tracking term, to train iplanner's networks further. ppo: minus U_path is a reward. In all but iwalker iStepper learns
from U_step on top, without its gradient into iPath."""

MOST_ROWS = 65_536
"""Of a training batch."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything that determines a training run.

    Attributes:
        method: what teaches iPath; see `Method`.
        source: frames to train on.
        planner: network sizes, and the camera, foot placement and pendulum that they are made for.
        models: lower-level models and costs.
        weights: of the losses.
        gradient: how both MPCs are differentiated.
        ppo: settings of the method of that name.
        batch_size: frames a step; the paper uses 1.
        epochs: passes through the frames.
        learning_rate: peak of Adam's schedule (linear warm-up, cosine decay).
        warm_up: updates of the warm-up, a tenth of all at most; 0 starts at the peak.
        final_learning_rate: share of the peak left at the end; 1 keeps the peak.
        clip: largest global gradient norm; None lets every gradient pass.
        mirror: exchange left and right in every second frame.
        seed: of initialisation, order and augmentation.
        checkpoint_every: steps between checkpoints; an interruption loses at most these.
        keep_checkpoints: how many of the latest stay on disk.
    """

    method: Method = "iwalker"
    source: DataConfig = DataConfig()
    planner: PlannerConfig = PlannerConfig()
    models: PlannerModels = PlannerModels()
    weights: LossWeights = LossWeights()
    gradient: GradientMode = "implicit"
    ppo: PpoSettings = PpoSettings()
    batch_size: int = 16
    epochs: int = 160
    learning_rate: float = 1.5e-3
    warm_up: int = 100
    final_learning_rate: float = 0.02
    clip: float | None = 10.0
    mirror: bool = True
    seed: int = 0
    checkpoint_every: int = 200
    keep_checkpoints: int = 2

    def __post_init__(self) -> None:
        if self.method not in typing.get_args(Method):
            raise InputError(f"Unknown method {self.method!r}; choose one of {', '.join(typing.get_args(Method))}.")
        if min(self.batch_size, self.epochs, self.checkpoint_every, self.keep_checkpoints) < 1:
            raise InputError("batch_size, epochs, checkpoint_every and keep_checkpoints must be at least 1.")
        if self.batch_size > MOST_ROWS:
            raise InputError(f"A batch of {self.batch_size} frames fits no machine; give at most {MOST_ROWS}.")
        check_seed(self.seed, "the training")
        if not (self.learning_rate > 0 and 0 <= self.final_learning_rate <= 1) or self.warm_up < 0:
            raise InputError("The learning rate must be positive, final_learning_rate a share, warm_up not negative.")
        if self.clip is not None and not self.clip > 0:
            raise InputError("The largest gradient norm must be positive, or None for no clipping.")
        require_plain_numbers(self)
        if self.weights.uses_whole_body and not self.planner.step_weights.hold_com:
            raise InputError(
                "The whole-body losses ask what stepping feedback makes of a footstep, and step weights that leave the "
                "COM free give none; weigh orbit or terminal, or switch torque_margin, shortfall and placement off."
            )

    def total_steps(self, frames: int) -> int:
        """Number of batches for a data set of this many frames."""
        return self.epochs * max(1, frames // self.batch_size)

    @property
    def updates_per_step(self) -> int:
        """Optimiser updates that each batch is worth."""
        return self.ppo.epochs if self.method == "ppo" else 1


def paper_preset() -> TrainConfig:
    """The published set-up: networks, images, both lower levels with their bounds and plain Adam on single frames.

    The paper prints neither the weights of its losses nor its learning rate: these are ours.
    """
    return TrainConfig(
        planner=PlannerConfig(
            ipath=IPathConfig.published(),
            istepper=IStepperConfig.published(),
            steps=StepGeometry.published(),
            step_weights=StepMpcWeights.published(),
        ),
        models=PlannerModels(unicycle=UnicycleParameters.published()),
        weights=LossWeights(
            tracking=40.0,
            route=0.0,
            arrival=0.0,
            regret=0.0,
            progress=0.0,
            clearance=0.0,
            fear=0.0,
            step_collision=0.0,
            published_collision=0.003,
        ),
        gradient="stopped",
        batch_size=1,
        epochs=30,
        learning_rate=1e-4,
        warm_up=0,
        final_learning_rate=1.0,
        clip=None,
    )


def small_paper_preset() -> TrainConfig:
    """The published set-up on images of 90 x 160, which two CPU cores train in hours instead of days."""
    paper = paper_preset()
    ipath = dataclasses.replace(paper.planner.ipath, camera=Intrinsics())
    return dataclasses.replace(paper, planner=dataclasses.replace(paper.planner, ipath=ipath))


def quick_preset() -> TrainConfig:
    """A run of about a minute that shows every stage; its planner is not worth using."""
    return TrainConfig(source=DataConfig(frames=120), epochs=4, checkpoint_every=20)


PRESETS = {
    "default": TrainConfig,
    "paper": paper_preset,
    "paper-small": small_paper_preset,
    "quick": quick_preset,
}
"""What makes the configuration of each `--preset`."""
