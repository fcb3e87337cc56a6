"""Whether a calibration may be believed: what else would explain its touches, by how much worse."""
