"""Measure how well the robot walks: python -m experiments.walk_study [--suites nominal,pushes,robust,limits]."""

from iwalker_jax.commands.launch import walk_study

if __name__ == "__main__":
    walk_study()
