"""What files of Gazebo carry beside links and joints: water and thrusters of its plugins; SDF."""
