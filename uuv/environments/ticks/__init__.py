"""Compiled substeps of an action: physics, controller, and inputs of judges, in one call."""
