"""What all pictures share: drawing without a screen, colours, maps seen from above, the one way to write a figure."""

from pathlib import Path
from types import ModuleType
from typing import Any

import matplotlib
import numpy as np
from jaxtyping import Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iwalker_jax.errors import InputError
from iwalker_jax.perception import DEFAULT_GRID, GridSpec
from iwalker_jax.runtime import atomic_write

FOOT_COLOURS = {"right": "tab:orange", "left": "tab:blue"}
"""Colours of right and left feet in plots."""


def pyplot() -> ModuleType:
    """`matplotlib.pyplot`, which draws into memory unless another back end is in use already."""
    matplotlib.use("Agg", force=False)
    import matplotlib.pyplot as plt

    return plt


def save_figure(figure: Figure, file: Path, dpi: int = 80) -> None:
    """Write a figure as PNG and close it; its folder is created.

    Args:
        figure: of `pyplot`.
        file: to write.
        dpi: dots per inch.

    Raises:
        InputError: if the file cannot be written; one that was there before is kept.
    """
    file = Path(file)
    try:
        with atomic_write(file) as part:
            figure.savefig(part, dpi=dpi, format="png")
    except OSError as error:
        raise InputError(f"The picture {file} cannot be written ({error.strerror}); choose another place.") from error
    finally:
        pyplot().close(figure)


def show_on_ground(
    axis: Axes, values: Shaped[np.ndarray, "rows columns *colour"], grid: GridSpec = DEFAULT_GRID, **options: Any
) -> None:
    """Draw a map of the base frame as the robot sees the ground, x up and y to the left; plot points as (y, x) [m].

    Args:
        axis: to draw on.
        values: one a cell, or its colour.
        grid: where the cells lie.
        options: of `Axes.imshow`.
    """
    extent = (grid.y_max, grid.y_min, grid.x_min, grid.x_max)
    axis.imshow(values[::-1, ::-1], extent=extent, interpolation="nearest", **options)
    axis.set_aspect("equal")
