"""The vehicle that is simulated: one MjModel with thrusters, contacts, soil, and faults put on from outside."""
