"""Plans on single frames: metrics, tables and pictures."""
