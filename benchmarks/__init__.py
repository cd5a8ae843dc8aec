"""Quality and speed side by side with named peers: `python -m benchmarks.unicycle` and its neighbours."""
