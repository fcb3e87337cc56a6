"""C functions that MuJoCo calls within its step, compiled by numba: water, gears, thrusters,
soil.
"""
