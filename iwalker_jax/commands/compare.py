"""Tables I to III: the planner and its baselines on the same frames and seeds: python -m experiments.compare."""

import dataclasses
from pathlib import Path

from iwalker_jax.commands.shared.console import say
from iwalker_jax.commands.shared.training_study import StudyCommand, Variant, study_main
from iwalker_jax.evaluation import Table
from iwalker_jax.evaluation.frames import paper_text, save_paper_tables
from iwalker_jax.training import TrainConfig

NOTE = (
    "iwalker and ppo space their waypoints evenly by construction, which is all that Table III measures; the two "
    "baselines leave the spacing to their losses, as published (iplanner's motion loss asks for it). finetuned adds "
    "U_path's tracking term to iplanner's losses and starts from its networks. Published figures are single runs in "
    "other scenes: compare their order, not their size."
)
"""What a reader of the tables must know of the rows."""


def method_variants(config: TrainConfig) -> tuple[Variant, ...]:
    """Untrained networks; the heuristic baseline, whose waypoints are free as published; its fine-tuning with U_path
    added; PPO on the planner's own network and costs; and the planner."""
    free = dataclasses.replace(config.planner.ipath, even=False)
    heuristic = dataclasses.replace(config, method="iplanner", planner=dataclasses.replace(config.planner, ipath=free))
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
        Variant("iwalker", config),
    )


def show_paper_tables(table: Table, folder: Path) -> None:
    """Print and save Tables I to III."""
    say(paper_text(table, NOTE))
    save_paper_tables(table, folder, NOTE)


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
