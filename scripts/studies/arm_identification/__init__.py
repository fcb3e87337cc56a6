"""Studies of what a calibration makes of its inputs."""
