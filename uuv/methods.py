"""Methods of control and perception by name: those that a run can leave out, those that it can take as published."""

from typing import Literal

Method = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control"
]  # that a controller can do without
AblatedMethod = Literal[
    "compensation",
    "hydrodynamic-term",
    "dynamic-term",
    "contact-term",
    "drift-correction",
    "force-control",
    "fusion",
    "gyro-check",
]
NAVIGATION: frozenset[AblatedMethod] = frozenset({"fusion", "gyro-check"})  # those that are not of the controller
PublishedMethod = Literal["force-law", "normal-force-law", "tip-force", "identification"]
