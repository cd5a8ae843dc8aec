"""What a robot is asked to do in an episode: a scene, a start and goals."""
