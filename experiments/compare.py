"""Tables I to III: the planner and its baselines on the same frames and seeds: python -m experiments.compare."""

from iwalker_jax.commands.launch import compare

if __name__ == "__main__":
    compare()
