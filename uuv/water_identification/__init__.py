"""Identification of a vehicle's hydrodynamics from logs: replay, manoeuvres, command and study."""
