"""Where the package offers two ways of one thing, each beside the other: `python -m benchmarks.choices.qp_methods`."""
