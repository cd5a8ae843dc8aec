"""Commands: `python -m experiments.train`, `evaluate`, `compare`, `ablation`, `validate_recording`, `show_depth_noise`."""
