"""Scenario layer: the only code that connects the rooms (sim, perception, controllers, calib) into runs."""
