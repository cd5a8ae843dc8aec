"""Train iPath with a memory on policy, in surrogate walks: python -m experiments.train_memory [--preset NAME]."""

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from iwalker_jax.commands.shared.console import (
    STOPPED,
    config_file,
    ends_in_a_sentence,
    progress_bar,
    require_counts,
    require_devices,
    say,
)
from iwalker_jax.errors import InputError
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.files import require_writable, write_json
from iwalker_jax.streams import check_seed
from iwalker_jax.training.on_policy import (
    NETWORK_FILE,
    OnPolicyConfig,
    OnPolicyProgress,
    save_memory_ipath,
    train_on_policy,
)
from iwalker_jax.training.run_log import LoggerName, require_loggers

PRESETS = {
    "default": OnPolicyConfig(),
    "quick": OnPolicyConfig(scenes=96, robots=96, rounds=12),
}
"""default: the shipped network's. quick: a look at whether everything works."""


@dataclass(frozen=True)
class Command:
    """Train iPath with a memory where its own walks lead it.

    Attributes:
        preset: which configuration the other options start from.
        out: folder for checkpoint, metrics and network; an existing run in it is resumed.
        fresh: start anew even if the folder holds a run.
        scenes: that are walked in.
        rounds: of walking and learning in turn.
        robots: that walk at a time.
        learning_rate: at the start.
        seed: of everything.
        checkpoint_every: rounds.
        log: loggers beside the metrics file.
    """

    preset: Literal["default", "quick"] = "default"
    out: Path = Path("runs/memory")
    fresh: bool = False
    scenes: int | None = None
    rounds: int | None = None
    robots: int | None = None
    learning_rate: float | None = None
    seed: int | None = None
    checkpoint_every: int = 10
    log: tuple[LoggerName, ...] = ()


def config_of(command: Command) -> OnPolicyConfig:
    """The preset with the options that were given.

    Raises:
        InputError: for options out of range.
    """
    names = ("scenes", "rounds", "robots", "learning_rate", "seed")
    given = {name: getattr(command, name) for name in names if getattr(command, name) is not None}
    config = dataclasses.replace(PRESETS[command.preset], **given)
    check_seed(config.seed, "the training")
    if config.scenes > 100_000 or config.robots > 100_000:
        raise InputError("Give at most 100000 scenes and robots.")
    return config


@ends_in_a_sentence("the same command goes on from its checkpoint")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    require_counts(command, checkpoint_every=1)
    config = config_of(command)
    require_devices()
    require_loggers(command.log)
    require_writable(command.out)
    with progress_bar("rounds", config.rounds) as show:

        def report(progress: OnPolicyProgress) -> None:
            show(
                progress.round,
                f"reached {100 * progress.reached:.0f} %  collided {100 * progress.collided:.0f} %  "
                f"best {progress.report.best:.2f} m  {progress.frames_per_second:.0f} frames/s",
            )

        show(0, "making scenes, compiling: some minutes")
        result = train_on_policy(
            config,
            command.out,
            resume=not command.fresh,
            checkpoint_every=command.checkpoint_every,
            loggers=command.log,
            on_progress=report,
            say=say,
        )
    if result.rounds < config.rounds:
        return STOPPED
    write_json(config_file(command.out), config_to_dict(config))
    save_memory_ipath(command.out / NETWORK_FILE, result.network, config)
    say(
        f"The network is {command.out / NETWORK_FILE}; walk with it: "
        f"python -m experiments.evaluate --policies memory@{command.out}"
    )
    return 0
