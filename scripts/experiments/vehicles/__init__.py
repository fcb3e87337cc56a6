"""Vehicles: station keeping under pushes, hull and arm as one chain, vehicles beside the default
one.
"""
