"""Metrics of work with a gripper."""
