"""The way to the work in a check: hull and arm against the shapes of the site, motion by motion."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import mujoco
import numpy as np

from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.trajectories import PoseMove
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array
from uuv.tasks.start_place import clearance

# number of states of a motion that are looked at; the widest step of the hull is some 10 cm
_STATES = 16
_NEAR = 0.02  # [m] less than this between two shapes counts as contact


def met_on_the_way(
    scene: mujoco.MjModel, vehicle: Vehicle, way: Sequence[Array], placement: Placement
) -> tuple[str, float] | None:
    """Sentence and clearance [m] of the first contact on the way to the work; None: there is none.

    The arm is folded on the hull's way, unfolds at its end, and keeps its posture as the hull comes
    near. Without the tool's last approach, which is meant to touch.

    Args:
        scene: Compiled, with the vehicle and the object at its true pose.
        vehicle: The vehicle in it.
        way: Poses (4, 4) of the hull from the scan to the pose at which the arm unfolds.
        placement: Hull pose and posture at the stand-off.
    """
    q_home = np.array(vehicle.q_home)
    q_start = np.array(placement.q_start)
    before = way[-1]

    phases: tuple[tuple[str, Iterator[tuple[Array, Array]]], ...] = (
        ("on its way to the work", ((X, q_home) for X in _between(way))),
        (
            "while the arm unfolds",
            ((before, q_home + s * (q_start - q_home)) for s in np.linspace(0.0, 1.0, _STATES)),
        ),
        ("as it comes near", ((X, q_start) for X in _between([before, placement.X_WB]))),
    )
    for when, states in phases:
        for X_WB, q in states:
            clear = clearance(scene, vehicle, X_WB, q, _NEAR)
            if clear.distance < _NEAR:
                return f"{when} the vehicle is {clear}", clear.distance
    return None


def _between(poses: Sequence[Array]) -> Iterator[Array]:
    """States (4, 4) of straight motions through poses."""
    for start, end in pairwise(poses):
        move = PoseMove(0.0, 1.0, start, end)
        for share in np.linspace(0.0, 1.0, _STATES):
            yield move.at(share)[0]
