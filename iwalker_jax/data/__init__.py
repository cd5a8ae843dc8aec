"""Training frames from generated scenes, recordings and the robot's own episodes."""
