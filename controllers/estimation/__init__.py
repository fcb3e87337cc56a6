"""Estimation: contact force, disturbances of the hull, load, payload and friction."""
