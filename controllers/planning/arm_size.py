"""Size of an arm: its length, and the scale of the distances kept from an object."""

import numpy as np

from uuv.controllers.ik.chain import Chain

# number of joints with which an arm can give its tool any pose
from uuv.controllers.ik.priorities import FULL as FULL
from uuv.sim.interfaces.spatial import Array

# [m] length of a stretched arm, from which on the usual distances from an object apply
_USUAL = 1.5
# smallest scale: the errors of navigation and station keeping do not shrink with an arm
_LEAST = 0.4


def reach(chain: Chain) -> float:
    """Length [m] of the stretched arm, from joint to joint to the tip."""
    stations = np.vstack([np.zeros(3), chain.points, chain.X_base_tip0[:3, 3]])
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


def base_axis(chain: Chain, q: Array) -> float:
    """1 if the z axis of the arm's base points to the side of the work at `q` (n,), else -1."""
    return 1.0 if float(chain.forward(q)[2, 3]) >= 0.0 else -1.0


def size(chain: Chain) -> float:
    """Scale [-] of the distances that this arm keeps from an object; 1 for an arm of 1.5 m."""
    return min(1.0, max(_LEAST, reach(chain) / _USUAL))
