"""Methods of the inverse kinematics by name."""

from typing import Literal

# [Danilov 2021]: "plain" as published, "jacobian_free" its sweeps combined and accelerated.
# "hybrid" makes at most one sweep, then damped least squares. "priority" is for chains of fewer or
# more than six joints: position before tool axis before the turn about it before posture.
Method = Literal["hybrid", "jacobian_free", "plain", "priority"]


def tracking_method(method: Method, n: int) -> Method:
    """Method by which an arm of `n` joints tracks tool poses: "priority" for "hybrid" where there
    are not six.
    """
    return "priority" if method == "hybrid" and n != 6 else method
