"""What surrounds a run: start and exit codes, its folder, whole files, provenance."""
