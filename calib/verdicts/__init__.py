"""Whether a calibration may be believed: what else would explain its touches, and by how much
worse.
"""
