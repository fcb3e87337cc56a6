"""Benchmarks: each a command that times ours beside named peers, as ratios in one run."""
