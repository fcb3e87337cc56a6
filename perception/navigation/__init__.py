"""The vehicle's own state from IMU, DVL, vision, encoders and torque sensors."""
