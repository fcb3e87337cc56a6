"""Serial arms: kinematics by Denavit-Hartenberg rows, from tables, URDF or MJCF; published arms;
gear friction.
"""
