"""Logs of real vehicles: what an autopilot or a ROS recorder wrote, in this project's axes."""
