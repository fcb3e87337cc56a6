"""Calibration by touching: errors over many arms, wrong files, and the time of a fit."""
