"""Tables I to III: the planner and its baselines on the same frames and seeds: python -m experiments.compare."""

import dataclasses
from pathlib import Path

from iwalker_jax.commands.shared.console import say
from iwalker_jax.commands.shared.training_study import StudyCommand, Variant, study_main, with_free_spacing
from iwalker_jax.evaluation import Table
from iwalker_jax.evaluation.frames import REFERENCE_NAMES, paper_text, save_paper_tables
from iwalker_jax.training import TrainConfig

NOTE = (
    "A plan that touches something or falls short of its goal is charged in every metric, because all of them are best "
    "for a robot that stands still. stand still and straight line need no network and step at the nominal places. "
    "iwalker and ppo space their waypoints evenly by construction, which is all that Table III measures; iwalker, free "
    "spacing and the two baselines leave the spacing to their losses, as published. finetuned adds U_path's tracking "
    "term to iplanner's losses and starts from its networks. Published figures are single runs in other scenes: "
    "compare their order, not their size."
)
"""What a reader of the tables must know of the rows."""


def method_variants(config: TrainConfig) -> tuple[Variant, ...]:
    """Untrained networks; the heuristic baseline, whose waypoints are free as published; its fine-tuning with U_path
    added; PPO on the planner's own network and costs; the planner with free waypoints; and the planner."""
    free = with_free_spacing(config)
    heuristic = dataclasses.replace(free, method="iplanner")
    finetuned = dataclasses.replace(
        heuristic,
        method="finetuned",
        epochs=max(1, config.epochs // 4),
        learning_rate=0.1 * config.learning_rate,
    )
    return (
        Variant("untrained", config, trained=False),
        Variant("iplanner", heuristic),
        Variant("finetuned", finetuned, starts_from="iplanner"),
        Variant("ppo", dataclasses.replace(config, method="ppo", learning_rate=0.2 * config.learning_rate)),
        Variant("iwalker, free spacing", free),
        Variant("iwalker", config),
    )


def show_paper_tables(table: Table, folder: Path) -> None:
    """Print and save Tables I to III."""
    even = {variant.label for variant in method_variants(TrainConfig()) if variant.config.planner.ipath.even}
    even |= set(REFERENCE_NAMES)
    say(paper_text(table, NOTE, even))
    save_paper_tables(table, folder, NOTE, even)


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    return study_main(
        "compare",
        "Train the planner and the paper's baselines with several seeds each; print and save Tables I to III.",
        StudyCommand(out=Path("runs/compare")),
        method_variants,
        arguments,
        show_paper_tables,
    )
