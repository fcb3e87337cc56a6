"""Simulation: plant with exact hydrodynamics, sensors, the step loop, evaluation and reports."""

if __name__ != "uuv.sim":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.sim")
