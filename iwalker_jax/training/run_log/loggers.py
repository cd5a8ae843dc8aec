"""Loggers of others, TensorBoard and Weights & Biases, behind the interface of the run's own metrics file."""

import importlib.util
import os
import uuid
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, Protocol

from iwalker_jax.errors import InputError
from iwalker_jax.runtime.config_dict import config_to_dict
from iwalker_jax.runtime.files import first_line, write_text
from iwalker_jax.runtime.reading import read_text
from iwalker_jax.training.run_log.metrics_file import MetricsFile

LoggerName = Literal["tensorboard", "wandb"]


class MetricsLogger(Protocol):
    """Whatever hears of a training's metrics."""

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Hear the values of a step, by their names."""

    def close(self) -> None:
        """Nothing more will come."""


class TensorBoardLogger:
    """Writes TensorBoard events to `<run>/tensorboard`; what an earlier attempt wrote from `first_step` on is void."""

    def __init__(self, folder: Path, config: Any, first_step: int) -> None:
        from tensorboardX import SummaryWriter

        self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=first_step)

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Add a scalar a value."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def close(self) -> None:
        """Flush and close."""
        self._writer.close()


class WandbLogger:
    """Writes a run of Weights & Biases to `<run>/wandb`: offline, without network or account, unless WANDB_MODE says
    otherwise; `wandb sync` sends it. A training that resumes goes on with the same run.

    Raises:
        InputError: if the run cannot begin.
    """

    def __init__(self, folder: Path, config: Any, first_step: int) -> None:
        import wandb

        place = folder / "wandb" / "id.txt"
        resumes = first_step > 0 and place.exists()
        name = read_text(place).strip() if resumes else uuid.uuid4().hex[:8]
        write_text(place, name + "\n")
        try:
            self._run = wandb.init(
                project=os.environ.get("WANDB_PROJECT", "iwalker-jax"),
                name=folder.absolute().name,
                id=name,
                dir=str(folder),
                config=config_to_dict(config),
                mode=os.environ.get("WANDB_MODE", "offline"),  # type: ignore[arg-type]
                resume="allow" if resumes else None,
                settings=wandb.Settings(silent=True, console="off"),
            )
        except Exception as error:  # of wandb's own kinds, its checks' and the system's
            raise InputError(
                f"Weights & Biases cannot begin a run ({first_line(error)}); set WANDB_MODE=offline or leave it out."
            ) from error

    def write(self, step: int, values: Mapping[str, float]) -> None:
        """Log the values of a step."""
        self._run.log(dict(values), step=step)

    def close(self) -> None:
        """Finish the run."""
        self._run.finish()


LOGGERS: dict[LoggerName, tuple[str, str, Callable[[Path, Any, int], MetricsLogger]]] = {
    "tensorboard": ("tensorboardX", "log", TensorBoardLogger),
    "wandb": ("wandb", "wandb", WandbLogger),
}
"""Package of each logger, the extra that brings it, and what makes it of (run's folder, configuration, first step)."""


def require_loggers(names: Sequence[LoggerName]) -> None:
    """Refuse loggers whose package is not installed.

    Raises:
        InputError: for the first of them, with what to install.
    """
    for name in names:
        package, extra, _ = LOGGERS[name]
        if importlib.util.find_spec(package) is None:
            raise InputError(f"The logger {name} needs the package {package}; run: pip install 'iwalker-jax[{extra}]'.")


class RunLog:
    """The run's own metrics file and the loggers beside it, as one.

    Args:
        folder: of the run.
        config: dataclass that a logger shows beside the metrics.
        first_step: that the run begins or resumes at; what was logged from there on is written again.
        names: of the loggers.
        say: hears the sentences a user must read.

    Raises:
        InputError: if a logger's package is missing, or it cannot begin.
    """

    def __init__(
        self,
        folder: Path,
        config: Any,
        first_step: int = 0,
        names: Sequence[LoggerName] = (),
        say: Callable[[str], None] = print,
    ) -> None:
        require_loggers(names)
        others = [LOGGERS[name][2](folder, config, first_step) for name in dict.fromkeys(names)]
        self._loggers: list[MetricsLogger] = [MetricsFile(folder, first_step, say), *others]

    def write(self, step: int, values: Mapping[str, Any]) -> None:
        """Record the values of a step (numbers become floats)."""
        numbers = {name: float(value) for name, value in values.items()}
        for logger in self._loggers:
            logger.write(step, numbers)

    def close(self) -> None:
        """Close all."""
        for logger in self._loggers:
            logger.close()
