"""Faults of sensors and thrusters at work, steps of the gyro, and runs in which nothing fails."""
