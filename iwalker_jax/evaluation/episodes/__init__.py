"""Episodes by sight: studies of them, metrics, tables, pictures, films and the report."""

from iwalker_jax.evaluation.episodes.film import FilmSettings, film_frames, write_film
from iwalker_jax.evaluation.episodes.log import EpisodeKey, load_episodes, load_logs
from iwalker_jax.evaluation.episodes.metrics import (
    EpisodeMetrics,
    batch_metrics,
    episode_metrics,
    goals_reached,
    judged,
    landing_errors,
    row_of,
    shortest_route,
)
from iwalker_jax.evaluation.episodes.pictures import draw_episode, save_episode, save_episode_grid
from iwalker_jax.evaluation.episodes.report import Report, write_report
from iwalker_jax.evaluation.episodes.schedule import (
    EPISODE_SETS,
    NETWORKS_MARK,
    EpisodeBatch,
    ScheduledEpisode,
    StudySettings,
    named_sets,
    policy_and_networks,
)
from iwalker_jax.evaluation.episodes.study import EpisodeRunner, MakeRunner, Study, StudyProgress, run_episode_study
from iwalker_jax.evaluation.episodes.surface_distance import AROUND, least_surface_distance, original_surface
from iwalker_jax.evaluation.episodes.tables import EPISODE_COLUMNS, episode_table, episode_values, failures
from iwalker_jax.evaluation.episodes.traces import load_traces, save_traces

__all__ = [
    "AROUND",
    "EPISODE_COLUMNS",
    "EPISODE_SETS",
    "NETWORKS_MARK",
    "EpisodeBatch",
    "EpisodeKey",
    "EpisodeMetrics",
    "EpisodeRunner",
    "FilmSettings",
    "MakeRunner",
    "Report",
    "ScheduledEpisode",
    "Study",
    "StudyProgress",
    "StudySettings",
    "batch_metrics",
    "draw_episode",
    "episode_metrics",
    "episode_table",
    "episode_values",
    "failures",
    "film_frames",
    "goals_reached",
    "judged",
    "landing_errors",
    "least_surface_distance",
    "load_episodes",
    "load_logs",
    "load_traces",
    "named_sets",
    "original_surface",
    "policy_and_networks",
    "row_of",
    "run_episode_study",
    "save_episode",
    "save_episode_grid",
    "save_traces",
    "shortest_route",
    "write_film",
    "write_report",
]
