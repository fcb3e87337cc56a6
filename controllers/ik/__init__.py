"""Parts of the inverse kinematics `controllers.mkps`: chains, and one compiled solver per file."""
