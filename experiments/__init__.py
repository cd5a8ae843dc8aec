"""Commands: `python -m experiments.train`, `evaluate`, `compare`, `ablation` and tools for recordings and noise."""
