"""Hydrodynamics of a model from its geometry (URDF, MJCF, mesh): volume, centre of buoyancy, added
mass, drag.
"""
