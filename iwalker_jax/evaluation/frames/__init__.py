"""Plans on single frames: metrics, tables and pictures."""

from iwalker_jax.evaluation.frames.columns import FRAME_COLUMNS, UNCHARGED_COLUMNS, frame_values
from iwalker_jax.evaluation.frames.metrics import (
    PlanMetrics,
    TrueMetrics,
    goal_in_view,
    goal_served,
    plan_metrics,
    true_metrics,
)
from iwalker_jax.evaluation.frames.paper_tables import PAPER_TABLES, PaperTable, paper_text, save_paper_tables
from iwalker_jax.evaluation.frames.pictures import save_sheet
from iwalker_jax.evaluation.frames.plan_picture import draw_plan
from iwalker_jax.evaluation.frames.reference_plans import REFERENCE_NAMES, ReferencePlanner
from iwalker_jax.evaluation.frames.report import evaluate_all, standard_sequences
from iwalker_jax.evaluation.frames.sequences import (
    FrameSequence,
    SequenceResult,
    evaluate_sequence,
    goal_routes,
    record_held_out_sequence,
    record_unseen_scenes,
)
from iwalker_jax.evaluation.frames.shortfall import ShortfallCharge, charged

__all__ = [
    "FRAME_COLUMNS",
    "PAPER_TABLES",
    "REFERENCE_NAMES",
    "UNCHARGED_COLUMNS",
    "FrameSequence",
    "PaperTable",
    "PlanMetrics",
    "ReferencePlanner",
    "SequenceResult",
    "ShortfallCharge",
    "TrueMetrics",
    "charged",
    "draw_plan",
    "evaluate_all",
    "evaluate_sequence",
    "frame_values",
    "goal_in_view",
    "goal_routes",
    "goal_served",
    "paper_text",
    "plan_metrics",
    "record_held_out_sequence",
    "record_unseen_scenes",
    "save_paper_tables",
    "save_sheet",
    "standard_sequences",
    "true_metrics",
]
