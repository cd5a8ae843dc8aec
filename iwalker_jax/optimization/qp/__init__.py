"""Dense convex quadratic programs: problem, solver, derivatives."""
