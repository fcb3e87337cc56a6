"""What an arm carries in place of the default pad: sampling tools, and the pin for calibration."""
