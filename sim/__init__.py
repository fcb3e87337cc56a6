"""Simulation: plant with exact hydrodynamics, sensors, the step loop, evaluation and reports."""
