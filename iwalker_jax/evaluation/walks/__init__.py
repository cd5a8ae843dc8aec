"""Walks on planned footsteps: metrics, tables and pictures."""

from iwalker_jax.evaluation.walks.metrics import (
    Landings,
    WalkMetrics,
    find_landings,
    robot_rows,
    speed_error,
    walk_metrics,
    walk_record,
)
from iwalker_jax.evaluation.walks.pictures import save_walk_sheet
from iwalker_jax.evaluation.walks.tables import (
    EMPTY_WALK_TABLE,
    WALK_COLUMNS,
    WalkLabels,
    has_case,
    load_walk_table,
    summarise,
    with_case,
)
from iwalker_jax.evaluation.walks.traces import save_trace_grid

__all__ = [
    "EMPTY_WALK_TABLE",
    "WALK_COLUMNS",
    "Landings",
    "WalkLabels",
    "WalkMetrics",
    "find_landings",
    "has_case",
    "load_walk_table",
    "robot_rows",
    "save_trace_grid",
    "save_walk_sheet",
    "speed_error",
    "summarise",
    "walk_metrics",
    "walk_record",
    "with_case",
]
