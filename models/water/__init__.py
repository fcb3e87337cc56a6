"""Water on a body: forms and bounds of its coefficients; thrusters, their static curves and their table in an MjSpec."""
