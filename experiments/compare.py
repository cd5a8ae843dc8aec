"""Compare the planner with its baselines on the same frames and seeds: python -m experiments.compare [--seeds 3]."""

from iwalker_jax.runtime import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import dataclasses
from pathlib import Path

from experiments.study import StudyCommand, Variant, study_main
from iwalker_jax.training.config import TrainConfig
from iwalker_jax.training.losses import LossWeights


def variants(config: TrainConfig) -> tuple[Variant, ...]:
    """Untrained networks, the heuristic baseline, its fine-tuning with the tracking loss alone, and the planner."""
    tracking_alone = LossWeights(
        tracking=config.weights.tracking, route=0, arrival=0, regret=0, progress=0, clearance=0, fear=0
    )
    heuristic = dataclasses.replace(config, method="iplanner")
    finetuned = dataclasses.replace(
        config,
        method="finetuned",
        weights=tracking_alone,
        epochs=max(1, config.epochs // 4),
        learning_rate=0.1 * config.learning_rate,
    )
    return (
        Variant("untrained", config, trained=False),
        Variant("iplanner", heuristic),
        Variant("finetuned", finetuned, starts_from="iplanner"),
        Variant("iwalker", config),
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return study_main(
        "compare",
        "Train the planner and the paper's baselines with several seeds each and print one table.",
        StudyCommand(out=Path("runs/compare")),
        variants,
        arguments,
    )


if __name__ == "__main__":
    raise SystemExit(main())
