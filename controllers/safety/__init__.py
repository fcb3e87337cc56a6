"""Fault detection, and the safety wrapper around any controller."""
