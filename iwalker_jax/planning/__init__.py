"""iPath, iStepper, and the geometry of paths and footsteps."""
