"""Metrics of a run, computed from its recording and the ground truth."""
