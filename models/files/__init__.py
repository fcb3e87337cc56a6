"""Readers and writers of vehicle descriptions: MJCF, URDF, SDF, map of parts, water file,
keyframes.
"""
