"""Perturbations: deviations of plant, scene or loop from what the controller believes."""
