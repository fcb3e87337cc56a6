"""Simulated sensors: truth in, noisy and late messages out."""
