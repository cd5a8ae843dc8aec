"""Ablation: gradient mode of the MPCs, and U_step's gradient into iPath on or off: python -m experiments.ablation."""

from iwalker_jax.runtime import configure_runtime

if __name__ == "__main__":
    configure_runtime()

import dataclasses
from pathlib import Path

from experiments.study import StudyCommand, Variant, study_main
from iwalker_jax.training.config import TrainConfig


def variants(config: TrainConfig) -> tuple[Variant, ...]:
    """implicit, unrolled and stopped, each with and without U_step's gradient into iPath."""
    made = []
    for gradient in ("implicit", "unrolled", "stopped"):
        for joint in (True, False):
            weights = dataclasses.replace(config.weights, step_to_path=joint)
            changed = dataclasses.replace(config, gradient=gradient, weights=weights)
            made.append(Variant(f"{gradient}-{'joint' if joint else 'apart'}", changed))
    return tuple(made)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return study_main(
        "ablation",
        "Train every combination of gradient mode and gradient routing and print one table.",
        StudyCommand(out=Path("runs/ablation"), seeds=1, epochs=15),
        variants,
        arguments,
    )


if __name__ == "__main__":
    raise SystemExit(main())
