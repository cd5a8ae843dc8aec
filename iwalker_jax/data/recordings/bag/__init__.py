"""Bags of ROS 1 and ROS 2 as recordings, read without ROS: depth, calibration, odometry and transforms."""

from iwalker_jax.data.recordings.bag.layout import is_bag, read_bag_layout

__all__ = ["is_bag", "read_bag_layout"]
