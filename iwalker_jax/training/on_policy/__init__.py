"""Training of iPath with a memory where its own walks lead it, judged by the true scene."""

from iwalker_jax.training.on_policy.config import OnPolicyConfig, PathWeights
from iwalker_jax.training.on_policy.loop import OnPolicyProgress, OnPolicyResult, train_on_policy
from iwalker_jax.training.on_policy.losses import CandidateLosses, candidate_losses, proposal_loss
from iwalker_jax.training.on_policy.saved import (
    NETWORK_FILE,
    PRETRAINED_MEMORY_IPATH,
    is_memory_run,
    load_memory_ipath,
    memory_ipath_for,
    save_memory_ipath,
)

__all__ = [
    "NETWORK_FILE",
    "PRETRAINED_MEMORY_IPATH",
    "CandidateLosses",
    "OnPolicyConfig",
    "OnPolicyProgress",
    "OnPolicyResult",
    "PathWeights",
    "candidate_losses",
    "is_memory_run",
    "load_memory_ipath",
    "memory_ipath_for",
    "proposal_loss",
    "save_memory_ipath",
    "train_on_policy",
]
