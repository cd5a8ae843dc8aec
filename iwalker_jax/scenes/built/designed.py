"""What scenes designed by hand share: a layout of constant style and small dimensions, and furniture put by hand."""

from dataclasses import replace

import numpy as np

from iwalker_jax.scenes.built.layout import Furniture, Layout, Place
from iwalker_jax.scenes.built.oblique import HELD_OUT_STYLE


def designed_layout(key: tuple[int, int], bounds: tuple[float, float, float, float]) -> Layout:
    """An empty layout [m]; furniture draws its small dimensions, which the key makes constants of the design."""
    return Layout(np.random.default_rng(list(key)), replace(HELD_OUT_STYLE, open_doors=0.0), bounds)


def furnish(layout: Layout, pieces: list[tuple[Furniture, Place]]) -> None:
    """Build every piece in its place."""
    for furniture, place in pieces:
        furniture.build(layout, place)
