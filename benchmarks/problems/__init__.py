"""Optimisation problems with known outcomes, in NumPy alone: tests judge solvers by them and benchmarks time them."""
