"""Campaigns of many runs: random variation, process pool, statistics and reports."""
