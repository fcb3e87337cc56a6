"""Methods of control and perception by name: methods that a run can leave out, and published
methods.
"""

from typing import Literal, get_args

# methods that a controller can leave out
Method = Literal[
    "compensation",
    "hydrodynamic-term",
    "dynamic-term",
    "contact-term",
    "drift-correction",
    "force-control",
]
# methods that navigation can leave out
NavigationMethod = Literal["fusion", "gyro-check"]
AblatedMethod = Literal[Method, NavigationMethod]
NAVIGATION: frozenset[NavigationMethod] = frozenset(get_args(NavigationMethod))
# readings of the published force law, of which a controller has at most one
PublishedForce = Literal["force-law", "normal-force-law", "force-length-law"]
PublishedMethod = Literal[PublishedForce, "tip-force", "identification"]
FORCE_LAWS: tuple[PublishedForce, ...] = get_args(PublishedForce)
# what the contact force is estimated from: sensors of the joint torques, or motor torques
ForceSource = Literal["sensors", "motors"]
