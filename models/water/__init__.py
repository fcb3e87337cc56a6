"""Hydrodynamics of a body: forms and bounds of its coefficients. Thrusters: curves and tables."""
