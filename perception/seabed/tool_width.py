"""Accepted widths of a tool over which the normals of the seabed are averaged."""

from uuv.sim.interfaces.spatial import finite_number

NARROWEST, WIDEST = 1e-3, 10.0  # [m]


def checked_width(width: float, what: str = "the tool's width [m]") -> float:
    """`width` [m] if it is accepted; otherwise a ConfigurationError that begins with `what`."""
    return finite_number(width, what, least=NARROWEST, most=WIDEST)
