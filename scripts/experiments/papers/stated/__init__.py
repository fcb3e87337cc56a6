"""Statements of the papers, and their reader."""
