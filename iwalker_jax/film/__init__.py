"""Recorded motions as video, in a window or without a screen."""
