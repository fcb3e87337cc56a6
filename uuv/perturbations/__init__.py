"""Perturbations: deviations of plant, scene or loop from the controller's model."""
