"""Benchmarks: each command times our code beside named peers, as ratios within one run."""
