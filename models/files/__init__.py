"""Readers and writers of what describes a vehicle: MJCF, URDF, SDF, map of parts, water file,
keyframes.
"""
