"""Pictures of runs: stills and clips of a run, from memory or its folder, and the gallery."""
