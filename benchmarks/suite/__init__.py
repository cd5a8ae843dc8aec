"""What all benchmarks share: figures taken in turns, their report, its page, and what changed against another run."""
