"""Studies of sensors, identification and tool paths on scenes of known truth: cases, one run, summary."""
