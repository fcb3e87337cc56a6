"""Compiled substeps of an action: physics, controller, and what judges see, in one call."""
