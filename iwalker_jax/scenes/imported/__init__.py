"""Scenes from a user's own MJCF and mesh files."""
