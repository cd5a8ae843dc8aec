"""What plans, walks and episodes are worth: tables, intervals and pictures; a room for each of the three."""

from iwalker_jax.evaluation.figures import FOOT_COLOURS, pyplot, save_figure
from iwalker_jax.evaluation.intervals import mean_interval, wilson_interval
from iwalker_jax.evaluation.tables import Column, Table, aligned_text, markdown_table, spread

__all__ = [
    "FOOT_COLOURS",
    "Column",
    "Table",
    "aligned_text",
    "markdown_table",
    "mean_interval",
    "pyplot",
    "save_figure",
    "spread",
    "wilson_interval",
]
