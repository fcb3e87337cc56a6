"""Whether a calibration may be believed: held-out touches, the truth where it is known, and what else explains them."""
