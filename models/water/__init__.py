"""Water on a body: forms and bounds of its coefficients; curves and table of its thrusters."""
