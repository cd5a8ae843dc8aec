"""H-LIP and its step MPCs: which footsteps are dynamically feasible."""
