"""Ablation of gradients, terms and maps, one change at a time: python -m experiments.ablation [--seeds 3]."""

from iwalker_jax.commands.launch import ablation

if __name__ == "__main__":
    ablation()
