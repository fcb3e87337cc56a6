"""Pushes at full reach that the drives can hold, and the wrench that the thrusters are capable
of.
"""

import numpy as np

from experiments.vehicles.pushing import PushCase, holdable_directions
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import AXES, Allocation
from uuv.experiment import Table
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import spread_directions

# [rad] of the default arm, stretched out
POSTURES = {
    "ahead": (0.0, 0.2, 0.0, 0.0, 0.0, 0.0),
    "aside": (1.57, 0.4, 0.0, 0.0, 0.0, 0.0),
    "down": (0.0, 1.4, 0.1, 0.1, 0.0, 0.0),
}


def flow(speed: float) -> tuple[float, float, float]:
    """Current (3,) [m/s] of a given speed in W, horizontal, at 30 deg from x."""
    return (speed * float(np.cos(np.pi / 6)), speed * float(np.sin(np.pi / 6)), 0.0)


def push_case(directions: int, force: float, posture: str, gust: float, seed: int) -> PushCase:
    """Base case of the tables, with the directions in which the drives can hold the push.

    Args:
        directions: Number of directions, spread over the sphere.
        force: [N] of the push.
        posture: Posture of the arm, of POSTURES.
        gust: [m/s] standard deviation per axis.
        seed: Seed of sensor noise and gusts.

    Returns:
        The case.

    Raises:
        ConfigurationError: The drives bear the push in none of the directions.
    """
    model = vehicle_spec("uuv_puma").compile()
    q = np.array(POSTURES[posture])
    spread = spread_directions(directions)

    held = holdable_directions(Vehicle.of(model), ArmDynamics(model), q, spread, force)
    if not held.any():
        raise ConfigurationError(
            f"--force {force}: the arm's drives bear it in none of the directions"
        )

    return PushCase(
        directions_B=spread[held], q=q, force=force, gust=gust, current_W=flow(0.2), seed=seed
    )


def authority_table() -> Table:
    """Table of the greatest wrench along each axis, with all thrusters and without each one."""
    vehicle = Vehicle.of(vehicle_spec("uuv_puma").compile())
    allocation = Allocation(vehicle)
    cells = []
    for name in (None, *vehicle.thruster_names):
        left = allocation if name is None else allocation.without(name)
        rows = [*left.authority(), left.authority(spoiling=["yaw"])[0]]
        cells.append((name or "none", *(f"{low:.0f}, {high:.0f}" for low, high in rows)))
    return Table(
        title="Greatest wrench along one axis, all others zero [N, N m]",
        columns=("lost", *AXES, "surge, yaw free"),
        rows=cells,
    )
