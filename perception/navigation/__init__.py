"""Navigation: state estimation from IMU, DVL, vision, encoders and torque sensors."""
