"""Studies of what sensors and thrusters do wrong."""
