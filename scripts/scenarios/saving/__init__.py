"""Saved runs: what a run needs to go on from a phase."""
