"""Simulated sensors: from the true state to noisy, delayed measurements."""
