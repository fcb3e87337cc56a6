"""Projection: trajectories across an object, and rays from them to scan and model."""
