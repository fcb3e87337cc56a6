"""Simulated sensors that combine several rooms: camera on the arm, and coarse detection before a
look.
"""
