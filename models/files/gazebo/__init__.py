"""Content of Gazebo's files besides links and joints: water and thrusters of its plugins; SDF."""
