"""A tool that is led through soil by hand: the force of the soil from its kernel, without a
vehicle.
"""

import numpy as np

from uuv.models.site import soil_bed
from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import Soil, SoilTool
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.soil_force import press


class LedTool:
    """Soil under one tool, with its state."""

    def __init__(self, ground: Seabed, soil: Soil, tool: SoilTool) -> None:
        self._numbers = soil_bed.pack(ground, soil, tool)
        self.state = np.zeros(soil_bed.STATE)

    def reset(self) -> None:
        """Take the tool out of the soil."""
        self.state[:] = 0.0

    def step(self, p_W: Array, axis_W: Array) -> Array:
        """Force (3,) [N] in W on the face at `p_W` (3,) [m]; `axis_W` (3,) is the unit axis out of
        the tool.
        """
        force_W, self.state = press(self._numbers, np.array(p_W), np.array(axis_W), self.state)
        return force_W
