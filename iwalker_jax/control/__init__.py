"""From footsteps to joint torques: gait clock, stepping feedback, swing trajectory, tasks and the whole-body QP."""
