"""Water on a body: forms and bounds of its coefficients; thrusters: static curves, and their table in an MjSpec."""
