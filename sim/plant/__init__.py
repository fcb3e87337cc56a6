"""The simulated vehicle: one MjModel with thrusters, contacts, soil, and injected faults."""
