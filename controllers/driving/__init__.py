"""Driving: an operator's velocities and set force in place of a planned task."""
