"""Hydrodynamics inside MuJoCo's step: the passive callback, reaction wrenches, the current."""
