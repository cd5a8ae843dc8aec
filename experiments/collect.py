"""Collect training frames from the robot's own episodes: python -m experiments.collect --run runs/default."""

from iwalker_jax.commands.launch import collect

if __name__ == "__main__":
    collect()
