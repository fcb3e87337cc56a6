"""Parts of the inverse kinematics `uuv.controllers.mkps`: chains, and one compiled solver per
file.
"""
