"""Motion planning of the hull: placement, paths past the object, trajectories, height above the
seabed.
"""
