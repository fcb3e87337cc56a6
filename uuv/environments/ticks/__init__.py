"""Compiled substeps of an action: physics, controller and what judges see, several substeps in one call."""
