"""Verbs about vehicles: what one has, its water from geometry, the named models."""
