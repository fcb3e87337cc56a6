"""Vehicles of a user's own: MJCF or URDF with a mapping of parts, and the parts that are computed where absent."""
