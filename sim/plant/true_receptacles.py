"""True forces of a plug on the receptacles of a panel."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.models.naming import RECEPTACLE
from uuv.sim.interfaces.spatial import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueReceptacles:
    """Forces on receptacles as live views, in the order of the model; empty without a panel.

    Each is in the frame of the receptacle's mouth, z inwards: a plug that is pulled pulls along -z.
    """

    borne: tuple[Array, ...]  # (3,) [N] of the panel on each receptacle, which opposes the contacts

    @classmethod
    def of(cls, data: mujoco.MjData) -> Self:
        """The views of one simulation."""
        model = data.model
        views = []
        for number in range(model.nsensor):
            sensor = model.sensor(number)
            if sensor.name.startswith(RECEPTACLE):
                at = int(sensor.adr[0])
                views.append(data.sensordata[at : at + 3])
        return cls(borne=tuple(views))

    @property
    def force(self) -> Array:
        """Force (k, 3) [N] of contacts on each receptacle."""
        return -np.array(self.borne).reshape(-1, 3)
