"""Task planners of an intervention: contact work, insertion, inspection, seabed work, touching, fault responses."""
