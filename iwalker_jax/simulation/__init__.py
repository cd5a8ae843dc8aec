"""Scenes, depth rendering and noise, ground-truth routes, and the one module that touches MuJoCo."""
