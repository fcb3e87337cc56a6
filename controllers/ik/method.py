"""Methods of the inverse kinematics by name."""

from typing import Literal

# [Danilov 2021]: "plain" as published, "jacobian_free" its sweeps combined and accelerated.
# "hybrid" makes at most one sweep, then damped least squares. "priority" is for chains of fewer or
# more than six joints: position before tool axis before the turn about it before posture.
Method = Literal["hybrid", "jacobian_free", "plain", "priority"]


def tracking_method(method: Method, n: int) -> Method:
    """Method that tracks tool poses with `n` joints: "priority" for "hybrid" where n is not 6."""
    return "priority" if method == "hybrid" and n != 6 else method
