"""Parts of the inverse kinematics `uuv.controllers.mkps`: chains, one compiled solver per file."""
