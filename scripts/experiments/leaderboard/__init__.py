"""Table of the benchmark UUV contact."""
