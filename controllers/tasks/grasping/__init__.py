"""Work with driven jaws: phases of the gripper, and the planner that collects an object."""
