"""Verbs on runs that have ended: compare, replay, report, view, picture."""
