"""Benchmark "UUV contact": seeded cases, controllers in separate processes, scores from the true
state.
"""
