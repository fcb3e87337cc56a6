"""Benchmark "UUV contact": seeded cases, a door for controllers in a process of their own, scores
by the truth.
"""
