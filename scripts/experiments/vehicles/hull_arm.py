"""Benchmark: hull and arm as one chain, by priorities: random tool poses before each vehicle.

    ./uvw run scripts/experiments/vehicles/hull_arm.py

A target is the tool pose of a random posture, with the hull up to 1 m and 1 rad away from where it
starts. Start: the hull at the origin, the arm in `ready`. Limits are those of the joints; the hull
stays level.
"""

from uuv.start import parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass

import numpy as np
from rich.console import Console

from uuv import models
from uuv.controllers.mkps import IkOptions, solve
from uuv.controllers.planning.carried_arm import HULL_JOINTS, with_hull
from uuv.experiment.harness import Table
from uuv.experiment.options import at_least
from uuv.own_vehicle import OwnVehicle
from uuv.sim.interfaces.spatial import Array, inverse, log_so3
from uuv.sim.interfaces.streams import Streams

VEHICLES = ("bluerov2_heavy_alpha5", "uuv_puma", "uuv_puma_side", "rexrov2_arm7", "phoenix_smart3s")
AWAY = 1.0  # [m], [rad] of the hull from its start
INSIDE = 0.1  # share of a joint's range at either end that targets keep clear of
MET = 1e-5, 1e-3  # [m], [rad] within which a pose counts as met
SPARES = ("pad", "camera", "thrusters", "home", "ready")


@dataclass(kw_only=True)
class Options:
    """Hull and arm as one chain."""

    poses: int = 100
    """Tool poses for each vehicle."""
    seed: int = 0
    """Of the poses."""

    def __post_init__(self) -> None:
        at_least(self, poses=1)


def row(name: str, poses: int, streams: Streams) -> tuple[str, ...]:
    """Figures of one vehicle."""
    own = OwnVehicle.of(models.load(name), SPARES)
    vehicle, chain = own.vehicle, own.chain()
    whole, (low, high) = with_hull(chain, vehicle.X_BA), vehicle.q_limits.T
    start = np.concatenate([np.zeros(HULL_JOINTS), vehicle.q_ready])
    options = IkOptions(max_iterations=400)
    met, axis, moved, turned, within, spent = 0, 0, [], [], 0, 0.0
    for _ in range(poses):
        # A pose that hull and arm can reach.
        share = INSIDE + (1.0 - 2.0 * INSIDE) * streams["arm"].random(chain.n)
        hull = streams["hull"].uniform(-AWAY, AWAY, HULL_JOINTS)
        X = whole.forward(np.concatenate([hull, low + share * (high - low)]))

        began = time.perf_counter()
        found = solve(whole, X, start, *MET, "priority", options=options)
        spent += time.perf_counter() - began
        p, angle = _off(whole.forward(found.q), X)
        axis += found.converged
        met += p <= MET[0] and angle <= MET[1]
        arm = found.q[HULL_JOINTS:]
        within += bool(np.all((arm >= low) & (arm <= high)))
        moved.append(float(np.linalg.norm(found.q[:3])))
        turned.append(abs(float(found.q[3])))
    return (
        name,
        str(chain.n),
        f"{axis}",
        f"{met}",
        f"{within}",
        f"{np.median(moved):.2f}",
        f"{np.median(turned):.2f}",
        f"{1e3 * spent / poses:.2f}",
    )


def _off(X: Array, target: Array) -> tuple[float, float]:
    """Distance [m] and angle [rad] of two poses."""
    there = inverse(X) @ target
    return float(np.linalg.norm(there[:3, 3])), float(np.linalg.norm(log_so3(there[:3, :3])))


def main() -> int:
    """Prints the table; returns 0."""
    options, console = parse(Options), Console(width=132)
    columns = (
        "vehicle",
        "joints",
        "position and axis",
        "whole pose",
        "in limits",
        "hull [m]",
        "yaw [rad]",
        "time [ms]",
    )
    rows = [row(name, options.poses, Streams(options.seed)) for name in VEHICLES]
    console.print(Table(f"{options.poses} tool poses a vehicle; medians", columns, rows).printed())
    return 0


if __name__ == "__main__":
    run_scenario(main)
