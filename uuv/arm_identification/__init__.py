"""Identification of the arm: friction of its gears, and the touches that would tell most for its
calibration.
"""
