"""Environment of a run: start and exit codes, folder of results, atomic files, provenance."""
