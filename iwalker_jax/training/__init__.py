"""Frames, losses, the train step and loop, checkpoints and baselines."""
