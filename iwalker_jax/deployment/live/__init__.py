"""A policy in real time: controller, planner and robot as processes that send each other small messages."""
