"""Where the hull goes and how: placement, paths past the object, trajectories, height over the seabed."""
