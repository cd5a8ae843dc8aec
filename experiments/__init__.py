"""Commands of a checkout, `python -m experiments.train` and its neighbours; installed they are `iwalker-train`, ..."""
