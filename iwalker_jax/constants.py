"""Numbers of the world and of the robot's clock that several rooms share."""

GRAVITY = 9.81
"""[m/s^2] of the simulation, of the pendulum and of what sensors and controller take for it."""

TIME_STEP = 0.002
"""[s] of BRUCE's physics, control and sensors unless a model says otherwise."""
