"""Perturbations: deviations of the plant, the scene or the loop from what the controller
believes.
"""
