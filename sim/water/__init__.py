"""Water: currents, flow fields, the motion of each simulation, the inertia with added mass."""
