"""Verdict on a calibration: other explanations of its touches, with their odds."""
