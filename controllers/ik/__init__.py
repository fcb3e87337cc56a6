"""The parts of the inverse kinematics `controllers.mkps`: chains, and one compiled solver a file."""
