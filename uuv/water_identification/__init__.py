"""Identification of a vehicle's water from logs: replay, manoeuvres, command and study."""
