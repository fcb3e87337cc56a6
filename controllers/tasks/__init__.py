"""Planners of an intervention: contact work, insertion, inspection, seabed work, touching, as
tables of phases.
"""
