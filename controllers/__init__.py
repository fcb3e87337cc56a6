"""Estimates and references to commands."""

import sim.interfaces  # noqa: F401  decides where compiled loops are kept
