"""Planners of an intervention as tables of phases: contact work, insertion, inspection, seabed."""
