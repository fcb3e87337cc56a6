"""Identification of hydrodynamics: from logs to added mass, damping, trim and thrust, with
intervals.
"""
