"""Walks on given footsteps: metrics, tables and plots."""
