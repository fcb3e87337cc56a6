"""Planners as tables of phases: contact work, insertion, inspection, seabed work, touching."""
