"""Motion planning of the hull: placement, paths past the object, trajectories, work height."""
