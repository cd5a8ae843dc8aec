"""A run's written record: its own metrics file, and loggers of others beside it, behind one interface."""

from iwalker_jax.training.run_log.loggers import LOGGERS, LoggerName, MetricsLogger, RunLog, require_loggers
from iwalker_jax.training.run_log.metrics_file import MetricsFile, read_metrics, save_broken_batch

__all__ = [
    "LOGGERS",
    "LoggerName",
    "MetricsFile",
    "MetricsLogger",
    "RunLog",
    "read_metrics",
    "require_loggers",
    "save_broken_batch",
]
