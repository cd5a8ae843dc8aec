"""Simulated depth beside a real camera's: python -m experiments.show_depth_noise [--real FOLDER]."""

from iwalker_jax.commands.launch import show_depth_noise

if __name__ == "__main__":
    show_depth_noise()
