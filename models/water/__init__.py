"""Thruster models: static curves, and their table on the actuators of an MjSpec."""
