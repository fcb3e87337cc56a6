"""Inverse kinematics: success, time, and other solvers beside it."""
