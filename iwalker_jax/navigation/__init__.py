"""The whole loop: camera, planner, walking and physics in episodes with goals, collisions, falls and an end."""
