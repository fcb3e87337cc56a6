"""From a wrench on the hull to thruster commands: allocation within bounds, then the inverse of the static curve."""

import numpy as np
from scipy.optimize import lsq_linear

from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

# Share that matters in each axis once thrusters saturate: attitude first, yaw last. [1/N] and [1/(N m)], relative.
_WEIGHTS = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 0.5])
_HEADROOM = 0.98  # of full thrust: what inflow and a wrong curve may take


class Allocation:
    """Thrusters of one vehicle, seen from its controller."""

    def __init__(self, vehicle: Vehicle) -> None:
        """Raises ConfigurationError if the thrusters cannot give a wrench in every direction."""
        self._B = np.array(vehicle.thruster_wrench)
        if np.linalg.matrix_rank(self._B) < 6:
            raise ConfigurationError(f"the {self._B.shape[1]} thrusters do not span all six directions of the hull")
        self._inverse = np.linalg.pinv(self._B)
        table = vehicle.thruster_table
        self._forward, self._reverse, self._band = table[:, 0], table[:, 1], table[:, 2]

    def thrust(self, wrench_B: Array) -> Array:
        """Thrusts (m,) [N] whose wrench is nearest to `wrench_B` (6,), within what each thruster can give.

        Exact (least norm) while no bound is met; otherwise the bounded least-squares solution, weighted so that
        attitude is kept first and yaw is given up first.
        """
        thrust = self._inverse @ wrench_B
        low, high = -_HEADROOM * self._reverse, _HEADROOM * self._forward
        if np.all(thrust >= low) and np.all(thrust <= high):
            return thrust
        return lsq_linear(_WEIGHTS[:, None] * self._B, _WEIGHTS * wrench_B, bounds=(low, high), method="bvls").x

    def command(self, thrust: Array) -> Array:
        """Normalised propeller speeds (m,) in [-1, 1] that give `thrust` (m,) [N] in still water."""
        gain = np.where(thrust >= 0.0, self._forward, self._reverse)
        reach = np.sqrt(np.minimum(np.abs(thrust) / gain, 1.0))
        return np.sign(thrust) * np.where(reach > 0.0, self._band + (1.0 - self._band) * reach, 0.0)
