"""Motion planning of the hull: placement, paths, trajectories, height above the seabed."""
