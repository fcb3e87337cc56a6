"""Methods of the inverse kinematics by name."""

from typing import Literal

# [Danilov 2021]: "plain" as published, "jacobian_free" its sweeps combined and accelerated. "hybrid" makes at most one
# sweep, then damped least squares.
Method = Literal["hybrid", "jacobian_free", "plain"]
