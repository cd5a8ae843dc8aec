"""The adapter to one robot's MuJoCo model: loading and checks, rigid-body terms, the physics step, leg kinematics."""
