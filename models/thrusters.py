"""Thruster tables: what a propeller gives for a command. They ride on the actuators of an MjSpec.

A command u in [-1, 1] is the normalised propeller speed asked for; the propeller follows with a first-order lag;
its thrust is quadratic beyond a dead band and is lessened by inflow, the bilinear model T = T_nn |n| n - T_nu |n| u_a
(Fossen 2011, section 9.3).
"""

from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields

import mujoco
import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array


@dataclass(frozen=True, slots=True, kw_only=True)
class Thruster:
    """One thruster: static curve, dynamics, inflow."""

    forward: float  # [N] thrust at command +1 in still water
    reverse: float  # [N] thrust magnitude at command -1 in still water
    dead_band: float = 0.0  # command magnitude below which there is no thrust, in [0, 1)
    time_constant: float = 0.0  # [s] first-order lag of the propeller speed
    inflow_loss: float = 0.0  # [N]/[m/s] thrust lost at full speed per unit of inflow along the thrust

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (np.isfinite(value) and value >= 0.0):
                raise ConfigurationError(f"thruster {item.name}: must be finite and >= 0, got {value}")
        if not self.dead_band < 1.0:
            raise ConfigurationError(f"thruster dead_band: must be in [0, 1), got {self.dead_band}")
        if not (self.forward > 0.0 and self.reverse > 0.0):
            raise ConfigurationError(f"thruster forward and reverse: must be > 0 N, got {self.forward}, {self.reverse}")


WIDTH = len(fields(Thruster))


def attach(spec: mujoco.MjSpec, table: Mapping[str, Thruster]) -> None:
    """Store `table` (actuator name -> Thruster) on the actuators of `spec`.

    Raises ConfigurationError if a name is not an actuator of `spec`.
    """
    actuators = {actuator.name: actuator for actuator in spec.actuators}
    for name, thruster in table.items():
        if name not in actuators:
            raise ConfigurationError(f"thruster {name!r}: no such actuator; there are {sorted(actuators)}")
        actuators[name].userdata = np.array(astuple(thruster))
    # Every actuator's row must have one length; absent values compile to zero, which reads as "no thruster".
    spec.nuser_actuator = max(spec.nuser_actuator, WIDTH)


def read(model: mujoco.MjModel) -> tuple[np.ndarray, Array]:
    """Actuators (m,) that are thrusters of `model`, and their table (m, WIDTH) in the order of `Thruster`'s fields."""
    if model.nuser_actuator < WIDTH:
        return np.zeros(0, dtype=np.int64), np.zeros((0, WIDTH))
    table = np.asarray(model.actuator_user)[:, :WIDTH]
    index = np.flatnonzero(table[:, 0] > 0.0)
    return index, table[index].copy()
