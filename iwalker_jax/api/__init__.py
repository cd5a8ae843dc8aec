"""Whole jobs in one call, on top of all other rooms: load a planner, walk, run episodes by sight."""

from typing import TYPE_CHECKING

from iwalker_jax.lazy_names import lazy_names

if TYPE_CHECKING:
    from iwalker_jax.api.episodes import EpisodesResult, run_episodes
    from iwalker_jax.api.planner import load_planner
    from iwalker_jax.api.walking import Engine, WalkResult, measure_walk, simulate_walk, walk

__all__ = [
    "Engine",
    "EpisodesResult",
    "WalkResult",
    "load_planner",
    "measure_walk",
    "run_episodes",
    "simulate_walk",
    "walk",
]

_HOMES = {
    "episodes": "EpisodesResult run_episodes",
    "planner": "load_planner",
    "walking": "Engine WalkResult measure_walk simulate_walk walk",
}

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
