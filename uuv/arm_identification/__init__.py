"""Identification of the arm: gear friction, and the most informative calibration touches."""
