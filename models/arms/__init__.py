"""Kinematics of arms: published tables, Denavit-Hartenberg rows out of an MJCF and back, friction in the gears."""
