"""Contact constraints of the physics step and their solver, differentiated at its solution."""
