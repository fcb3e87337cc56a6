"""Seeded scenes with an object, and commands on point clouds: options, reports and pictures of
identification, deformation map and seabed path.
"""
