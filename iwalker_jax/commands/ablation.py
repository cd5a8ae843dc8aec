"""Ablation of gradients, terms and maps, one change at a time: python -m experiments.ablation [--seeds 3]."""

import dataclasses
from pathlib import Path
from typing import Any

from iwalker_jax.commands.shared.training_study import StudyCommand, Variant, study_main, with_free_spacing
from iwalker_jax.training import TrainConfig


def ablation_variants(config: TrainConfig) -> tuple[Variant, ...]:
    """The default and what it is without one of its parts.

    unrolled, stopped: the other two gradients of both MPCs, `stopped` being the published one.
    apart: U_step does not reach iPath. uneven: waypoints spaced by the losses alone. published-map: the collision
    terms sample the paper's blurred map, at the footsteps, instead of the true distance field; the route's costs still
    come from the field. tracking-alone: the tracking term is all that U_path has, as published.
    """
    weights = config.weights

    def weighed(**changes: Any) -> TrainConfig:
        return dataclasses.replace(config, weights=dataclasses.replace(weights, **changes))

    return (
        Variant("implicit", config),
        Variant("unrolled", dataclasses.replace(config, gradient="unrolled")),
        Variant("stopped", dataclasses.replace(config, gradient="stopped")),
        Variant("apart", weighed(step_to_path=False)),
        Variant("uneven", with_free_spacing(config)),
        Variant("published-map", weighed(clearance=0.0, step_collision=0.0, published_collision=0.02)),
        Variant("tracking-alone", weighed(route=0.0, arrival=0.0, regret=0.0, progress=0.0, clearance=0.0)),
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return study_main(
        "ablation",
        "Train the planner without one of its parts at a time, with several seeds each, and print one table.",
        StudyCommand(out=Path("runs/ablation"), epochs=15),
        ablation_variants,
        arguments,
    )
