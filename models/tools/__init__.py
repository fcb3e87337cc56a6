"""Tools that replace the arm's default pad: samplers, and the pin for calibration."""
