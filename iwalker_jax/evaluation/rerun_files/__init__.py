"""Episodes, walks and recordings as files of the viewer rerun, everything on one time line."""

from iwalker_jax.evaluation.rerun_files.episodes import write_episode
from iwalker_jax.evaluation.rerun_files.recordings import write_recording
from iwalker_jax.evaluation.rerun_files.stream import require_rerun
from iwalker_jax.evaluation.rerun_files.walks import write_walk

__all__ = ["require_rerun", "write_episode", "write_recording", "write_walk"]
