"""Benchmarks of the water: geometry, identification, pool trials, REMUS 100."""
