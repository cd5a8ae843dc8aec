"""Write a policy for a robot that has JAX alone: python -m experiments.export --run runs/default."""

import sys
from dataclasses import dataclass
from pathlib import Path

import jax
import tyro

from iwalker_jax.commands.shared.console import (
    ends_in_a_sentence,
    progress_bar,
    require_counts,
    require_devices,
    say,
)
from iwalker_jax.commands.shared.planners import parameters_digest, planner_of
from iwalker_jax.deployment.exported_functions import exported_functions
from iwalker_jax.deployment.rehearsal import differing_frames
from iwalker_jax.deployment.writer import write_policy
from iwalker_jax.errors import InputError
from iwalker_jax.navigation import POLICIES, make_navigator
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.files import require_writable
from iwalker_jax.training.on_policy import memory_ipath_for


@dataclass(frozen=True)
class Command:
    """Write networks, memory, step planning and controller as artifacts that run without the training stack.

    The folder holds StableHLO artifacts for CPU and CUDA, a manifest that describes every input and output, and a
    loader of one file. docs/export.md says how to run them.

    Attributes:
        run: folder of a training run; the planner that ships with the package if left out.
        out: folder to write; a policy that is there already is replaced.
        policy: how to navigate: default, networks, published or classical; see experiments.evaluate.
        verify: camera frames of a walk through the office on which every artifact must give the same bits as the
            function it was made of; 0 for none.
        seed: of the walk's sensors and camera.
    """

    run: Path | None = None
    out: Path = Path("runs/policy")
    policy: str = "default"
    verify: int = 0
    seed: int = 0


@ends_in_a_sentence("the same command starts anew")
def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    command = tyro.cli(Command, args=arguments if arguments is not None else sys.argv[1:])
    return export_policy(command)


def export_policy(command: Command) -> int:
    """Write the folder, compare if that is wanted, and say what came out; 1 if anything differs.

    Raises:
        InputError: for options out of range, or a folder that cannot be written.
    """
    require_counts(command, verify=0, seed=0)
    if command.policy not in POLICIES:
        raise InputError(f"Unknown policy {command.policy!r}; choose one of {', '.join(POLICIES)}.")
    require_devices()
    require_writable(command.out)
    planner, config, name = planner_of(command.run)
    memory_ipath = memory_ipath_for(command.policy, command.run)
    navigator = make_navigator(command.policy, planner, sensors="none", depth_noise=False, memory_ipath=memory_ipath)
    exported = exported_functions(navigator)
    described = {
        "policy": command.policy,
        "weights": {"source": name, "sha256": parameters_digest(planner)},
        "configuration": config_to_dict(config),
    }
    with progress_bar("functions", len(exported)) as show:
        write_policy(command.out, navigator, exported, described, show)
    say(f"The policy {command.policy} of {name} is in {command.out}, for JAX {jax.__version__} and its neighbours.")
    if not command.verify:
        return 0
    with progress_bar("camera frames", command.verify) as show:
        differing = differing_frames(command.out, navigator, command.verify, command.seed, show)
    if differing:
        say("Bits differ: " + "; ".join(f"{function} in {count} calls" for function, count in differing.items()) + ".")
        return 1
    say(f"All outputs of {command.verify} camera frames are the same bit for bit.")
    return 0
