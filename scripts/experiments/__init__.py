"""Experiments: how good it is, against whom, and what the papers state.

One folder a subject; none imports another.
"""
