"""Metrics, tables and pictures of trained planners."""
