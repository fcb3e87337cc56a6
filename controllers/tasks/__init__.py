"""Tasks of an intervention: contact work, insertion, inspection, seabed work, touching, and reactions to faults."""
