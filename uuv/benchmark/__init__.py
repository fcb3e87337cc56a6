"""Benchmark "UUV contact": seeded cases, controllers in processes of their own, true scores."""
