"""Identification of objects: errors, decisions, looks, sensors, and other libraries beside it."""
