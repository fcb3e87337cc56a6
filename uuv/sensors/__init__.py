"""Simulated sensors that are made of several rooms: the camera on the arm."""
