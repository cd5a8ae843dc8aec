"""Metrics, tables and pictures of trained planners."""

from iwalker_jax.evaluation.episodes.pictures import save_episode
from iwalker_jax.evaluation.frames.plan_picture import draw_plan
from iwalker_jax.evaluation.walks.pictures import save_walk_sheet
from iwalker_jax.evaluation.walks.traces import save_trace_grid

__all__ = ["draw_plan", "save_episode", "save_trace_grid", "save_walk_sheet"]
