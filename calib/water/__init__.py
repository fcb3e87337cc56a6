"""Identification of added mass, damping, trim and thrust from logs, with intervals."""
