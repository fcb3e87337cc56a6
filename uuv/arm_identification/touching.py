"""Touching session: the arm presses a pin into nests under water, with the hull clamped or
hovering.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import Any, ClassVar

import mujoco
import numpy as np

from uuv.assembly import assemble
from uuv.controllers.mkps import Chain
from uuv.controllers.tasks.touching import Nest, Touch, TouchSequence, draw_touches
from uuv.controllers.whole_body.touch_controller import CompliantTouch
from uuv.models.naming import CAMERA_SITE, TOOL_GEOM
from uuv.models.tools import touch_rig
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import OwnVehicle
from uuv.runner import run_through
from uuv.scenario import PlacedTask, Scenario, Task, VehicleSetup
from uuv.sim.interfaces.errors import ReachError
from uuv.sim.interfaces.spatial import Array, inverse, pose
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Moment, Observer
from uuv.site import Site

# [m] distance of a reading from the median of its nest above which it missed the nest
MISSED = 0.03
LONGEST_PER_TOUCH = 30.0  # [s] limit of the simulated time for each touch
# [m] for a clamped hull: a pin that moves more than this during a reading is not seated
STILL = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """Readings of a touching session. True positions are for evaluation only."""

    series: tuple[Array, ...]  # (m_i, n) [rad] encoder readings, one array for each nest
    hulls: tuple[Array, ...]  # (m_i, 4, 4) hull pose X_WB as estimated by navigation
    hovering: bool  # False: the hull was clamped
    p_WN: Array  # (k, 3) [m] true nest positions in W
    # [m] largest true distance of the hull from its mean position, over the readings
    hull_motion: float
    tip_spread: float  # [m] RMS of the pin's true centre about its nest's mean
    missed: int  # number of touches that missed their nest and are left out
    simulated_s: float


class Readings:
    """Observer that collects encoder and navigation readings while the pin is held in a nest."""

    def __init__(self) -> None:
        self.q: dict[int, list[Array]] = {}
        self.X_WB: dict[int, list[Array]] = {}
        self.tip: dict[int, list[Array]] = {}
        self.hull: dict[int, list[Array]] = {}

    def observe(self, moment: Moment) -> None:
        """Append the readings of one step to those of the present touch."""
        target = moment.reference.touch
        if target is None:
            return
        self.q.setdefault(target, []).append(moment.estimate.q)
        self.X_WB.setdefault(target, []).append(moment.estimate.X_WB)
        self.tip.setdefault(target, []).append(np.array(moment.truth.p_WG))
        self.hull.setdefault(target, []).append(np.array(moment.truth.p_WB))


def place_nests(
    vehicle: Vehicle, chain: Chain, X_WB: Array, count: int, rng: np.random.Generator
) -> list[Nest]:
    """Place nests in front of the arm, open upwards, as far from each other as the arm's reach
    allows.

    Args:
        vehicle: The vehicle.
        chain: Kinematics of its arm.
        X_WB: (4, 4) pose of the hull.
        count: Number of nests.
        rng: Draws the postures that measure the reach, and the trial touches.

    Returns:
        The nests; farthest-point sampling of the reachable candidates.

    Raises:
        ReachError: Fewer than `count` places can be touched from enough directions.
    """
    X_WA = X_WB @ np.array(vehicle.X_BA)
    drawn = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1], (200, len(vehicle.joints)))
    reach = max(float(np.linalg.norm(chain.forward(q)[:3, 3])) for q in drawn)

    # Candidates on a grid in front of the arm, as shares of its reach.
    z = np.array([0.0, 0.0, 1.0])
    candidates = []
    for x in (0.35, 0.5, 0.65):
        for y in (-0.45, -0.3, 0.0, 0.3, 0.45):
            for drop in (0.25, 0.45, 0.6):
                p = X_WA[:3, 3] + reach * np.array([x, y, -drop])
                nest = Nest(p_WN=p, z_WN=z)
                try:
                    draw_touches(chain, inverse(X_WA), [nest], 6, rng, vehicle.q_ready, tries=9)
                except ReachError:
                    continue
                candidates.append(nest)

    if len(candidates) < count:
        raise ReachError(
            f"nests: the arm must reach {count} positions from enough directions, it reaches "
            f"{len(candidates)}"
        )

    # Farthest-point sampling.
    chosen = [candidates[0]]
    while len(chosen) < count:
        gaps = [min(float(np.linalg.norm(c.p_WN - o.p_WN)) for o in chosen) for c in candidates]
        chosen.append(candidates[int(np.argmax(gaps))])
    return chosen


@dataclass(frozen=True, kw_only=True)
class _TouchingTask(Task):
    """Task of touching nests with a pin as tool; not for scenario files, whose runs may not touch
    the site.
    """

    spares: ClassVar[Collection[str]] = (CAMERA_SITE, TOOL_GEOM)
    hovering: bool  # True: station keeping with the thrusters; False: the hull is clamped
    nests: int
    touches: int  # number of touches of each nest

    def place(
        self, scenario: Scenario, own: OwnVehicle, rng: np.random.Generator
    ) -> "PlacedTouching":
        """Draw the nests in front of the arm, and the touches.

        Raises:
            ReachError: The arm does not reach enough nests or directions.
        """
        placing, drawing = rng.spawn(2)
        X_WB = np.eye(4)
        nests = place_nests(own.vehicle, own.chain(), X_WB, self.nests, placing)
        X_AW = inverse(X_WB @ np.array(own.vehicle.X_BA))
        touches = draw_touches(own.chain(), X_AW, nests, self.touches, drawing, own.vehicle.q_ready)
        return PlacedTouching(task=self, own=own, nests=nests, wanted=touches)


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedTouching(PlacedTask):
    """Nests at their places, the touches, and their readings during a run."""

    exact_start: ClassVar[bool] = True
    task: _TouchingTask
    own: OwnVehicle
    nests: list[Nest]
    wanted: list[Touch]
    readings: Readings = field(default_factory=Readings)

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Touching, hull {'hovering' if self.task.hovering else 'clamped'}"

    @property
    def X_WB(self) -> Array:
        """Pose of the hull: the origin of W."""
        return np.eye(4)

    def scene(self, vehicle: mujoco.MjSpec) -> mujoco.MjSpec:
        """Add pin and nests, and clamp the hull unless it hovers."""
        touch_rig.add_pin(vehicle)
        touch_rig.add_nests(
            vehicle, [nest.p_WN for nest in self.nests], [nest.z_WN for nest in self.nests]
        )
        if not self.task.hovering:
            touch_rig.clamp(vehicle, self.X_WB)
        return vehicle

    def planner(self) -> TouchSequence:
        """Planner that makes one touch after another."""
        return TouchSequence(self.own.vehicle, self.own.chain(), self.nests, self.wanted, self.X_WB)

    def controller(self) -> CompliantTouch:
        """Controller for compliant touching."""
        return CompliantTouch(self.own.model, clamped=not self.task.hovering)

    def story(self, recorder: Recorder, log: Any) -> Readings:
        """Observer that takes the readings."""
        return self.readings

    def session(self, simulated_s: float) -> Session:
        """Readings of the run, without missed touches; `simulated_s` [s] is its duration."""
        chain = self.own.chain()
        readings = self.readings
        series: list[list[Array]] = [[] for _ in self.nests]
        hulls: list[list[Array]] = [[] for _ in self.nests]
        tips: list[list[Array]] = [[] for _ in self.nests]
        places: list[Array] = []
        missed = 0

        for k in range(len(self.nests)):
            # Mean readings of each touch of the nest, and the tip position from the believed arm.
            mine = [
                i for i, target in enumerate(self.wanted) if target.nest == k and i in readings.q
            ]
            means = {i: np.mean(readings.q[i], axis=0) for i in mine}
            poses = {i: readings.X_WB[i][len(readings.X_WB[i]) // 2] for i in mine}
            tips_W = {
                i: (poses[i] @ self.own.vehicle.X_BA @ chain.forward(means[i]))[:3, 3] for i in mine
            }
            middle = np.median(list(tips_W.values()), axis=0) if tips_W else np.zeros(3)

            # A touch missed the nest if the pin moved, or if it lies away from the other touches.
            for i in mine:
                ends = [chain.forward(readings.q[i][at])[:3, 3] for at in (0, -1)]
                moves = not self.task.hovering and float(np.linalg.norm(ends[1] - ends[0])) > STILL
                if moves or float(np.linalg.norm(tips_W[i] - middle)) > MISSED:
                    missed += 1
                    continue

                series[k].append(means[i])
                hulls[k].append(_mean_pose(readings.X_WB[i]))
                tips[k].append(np.mean(readings.tip[i], axis=0))
                places.append(np.mean(readings.hull[i], axis=0))

        spread = np.concatenate(
            [np.array(of_nest) - np.mean(of_nest, axis=0) for of_nest in tips if of_nest]
        )
        return Session(
            series=tuple(np.array(q) for q in series),
            hulls=tuple(np.array(X_WB) for X_WB in hulls),
            hovering=self.task.hovering,
            p_WN=np.array([nest.p_WN for nest in self.nests]),
            hull_motion=float(
                np.linalg.norm(np.array(places) - np.mean(places, axis=0), axis=1).max()
            ),
            tip_spread=float(np.sqrt((spread**2).sum(axis=1).mean())),
            missed=missed,
            simulated_s=simulated_s,
        )


def touching_scenario(
    vehicle: VehicleSetup, site: Site, *, hovering: bool, nests: int, touches: int, seed: int
) -> Scenario:
    """Scenario of a touching session.

    Args:
        vehicle: The vehicle, with the errors of its arm.
        site: Current and gusts.
        hovering: True: station keeping with the thrusters; False: the hull is clamped.
        nests: Number of nests.
        touches: Touches of each nest.
        seed: Seed of nests, touches, gusts and sensor noise.
    """
    task = _TouchingTask(hovering=hovering, nests=nests, touches=touches)
    return Scenario(name="touching", task=task, seed=seed, site=site, vehicle=vehicle)


def touch(
    scenario: Scenario, watch: Callable[[mujoco.MjModel], Observer] | None = None
) -> tuple[Session, OwnVehicle]:
    """Run a touching session with the true arm, controlled by its believed model.

    Args:
        scenario: Scenario from `touching_scenario`.
        watch: Makes a further observer of the loop for the compiled world.

    Returns:
        Readings and true figures, and the controller's model of the vehicle.

    Raises:
        UuvError: The vehicle lacks a part, or the arm does not reach enough nests or directions.
    """
    assembly = assemble(scenario)
    placed = assembly.placed
    model = assembly.plant.model
    assert isinstance(placed, PlacedTouching)
    observers: list[Observer] = (
        [placed.readings] if watch is None else [placed.readings, watch(model)]
    )
    ran = run_through(
        assembly, observers=observers, longest=LONGEST_PER_TOUCH * (len(placed.wanted) + 1)
    )
    return placed.session(ran.last.truth.time), placed.own


def _mean_pose(X: list[Array]) -> Array:
    """Mean of poses that differ little: mean of the positions, and mean rotation projected onto
    SO(3).
    """
    middle = np.mean(X, axis=0)
    U, _, Vt = np.linalg.svd(middle[:3, :3])
    return pose(U @ Vt, middle[:3, 3])
