"""Figures of a run, from its recording and the truth."""
