"""The unicycle MPC: which path can be tracked."""
