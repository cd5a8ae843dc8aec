"""Other solvers behind the benchmarks' own words; whatever is not installed is imported only when it is called."""
