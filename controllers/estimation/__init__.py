"""Estimation: contact force, disturbances on the hull, load, payload and friction."""
