"""Arm control: inverse dynamics, joint servo, force control, compliance."""
