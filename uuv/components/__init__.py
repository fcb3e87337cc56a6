"""Parts of a loop: sensors, controller and models of a scenario, the arm's deck calibration."""
