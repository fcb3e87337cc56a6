"""Simulated sensors that no room has alone: camera on the arm, coarse detection before a look."""
