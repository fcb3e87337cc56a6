"""Verbs about vehicles: their check, hydrodynamic data from geometry, the named models."""
