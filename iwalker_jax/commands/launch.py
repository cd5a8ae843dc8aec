"""Starts a command with the process settings that must be chosen before JAX is imported.

`python -m experiments.train` in a checkout and the installed `iwalker-train` both come here; the latter takes no
module from the present folder.
"""

import importlib
import os
import sys
from functools import partial
from typing import NoReturn

from iwalker_jax.film import headless
from iwalker_jax.runtime import settings

_DRAWING_3D = ("evaluate", "walk")

_READER_GONE = 128 + 13
"""Exit status of a program that a closed pipe ended, as a shell counts it (SIGPIPE is 13)."""


def launch(name: str) -> NoReturn:
    """Run the command of a name with the process's arguments and leave with its status."""
    settings.configure_runtime(settings.requested_devices(sys.argv))
    if name in _DRAWING_3D:
        headless.configure_rendering()
    try:
        status = importlib.import_module(f"iwalker_jax.commands.{name}").main()
        sys.stdout.flush()
    except BrokenPipeError:
        # Whoever read the output has gone, as `head` does; what Python still holds back must not meet the pipe again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = _READER_GONE
    # It imports JAX, which the settings must come before.
    from iwalker_jax.runtime.processes import exit_process

    exit_process(status)


ablation = partial(launch, "ablation")
collect = partial(launch, "collect")
compare = partial(launch, "compare")
evaluate = partial(launch, "evaluate")
export = partial(launch, "export")
run_policy = partial(launch, "run_policy")
show_depth_noise = partial(launch, "show_depth_noise")
train = partial(launch, "train")
train_memory = partial(launch, "train_memory")
validate_recording = partial(launch, "validate_recording")
walk = partial(launch, "walk")
walk_study = partial(launch, "walk_study")
whole_body_study = partial(launch, "whole_body_study")
