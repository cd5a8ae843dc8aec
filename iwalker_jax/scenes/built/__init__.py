"""Scenes that are generated or designed by hand."""
