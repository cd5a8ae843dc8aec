"""Let simulated robots walk: python -m experiments.walk [--motion s_curve] [--robots 1] or [--scene factory]."""

from iwalker_jax.commands.launch import walk

if __name__ == "__main__":
    walk()
