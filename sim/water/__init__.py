"""Hydrodynamics inside MuJoCo's step: the passive callback, access to MuJoCo's memory, and the current."""
