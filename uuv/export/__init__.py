"""A run's data in the formats of other tools: MCAP, ROS 2 bags, CSV, MATLAB."""
