"""Commands on point clouds: identification, deformation map, seabed path, with their reports."""
