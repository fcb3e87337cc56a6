"""Reproduced figures and tables of the papers."""
