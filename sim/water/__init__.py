"""Water: currents, flow fields, motion of the water in each simulation, and the inertia with added
mass.
"""
