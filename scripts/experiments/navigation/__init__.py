"""Error model of the camera on the arm."""
