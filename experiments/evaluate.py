"""Evaluate a planner on single frames and in episodes by sight: python -m experiments.evaluate [--run FOLDER]."""

from iwalker_jax.commands.launch import evaluate

if __name__ == "__main__":
    evaluate()
