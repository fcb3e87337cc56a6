"""Touching session: the built arm presses a pin into nests under water, the hull clamped or hovering."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from controllers.mkps import Chain
from controllers.tasks.touching import Nest, Touch, TouchSequence, draw_touches
from controllers.touch_controller import CompliantTouch
from models.naming import CAMERA_SITE, TOOL_GEOM
from models.tools import touch_rig
from models.vehicle import Vehicle
from perception.navigation.strapdown_filter import Navigation
from scenarios.own_vehicle import OwnVehicle
from scenarios.scenario import Sensing
from sim import hydrodynamics
from sim.interfaces.errors import ReachError
from sim.interfaces.spatial import Array, inverse, pose
from sim.loop.rollout import Moment, Observer, Parts, rollout
from sim.plant.plant import Plant
from sim.water.current import Current

MISSED = 0.03  # [m] a reading farther than this from the median of its nest missed the nest
LONGEST_PER_TOUCH = 30.0  # [s] simulated, limit for each touch
STILL = 1e-4  # [m] clamped hull: a pin that moves more than this during a reading is not seated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Session:
    """Readings of a touching session; true positions are for evaluation only."""

    series: tuple[Array, ...]  # (m_i, n) [rad] encoder readings, one array for each nest
    hulls: tuple[Array, ...]  # (m_i, 4, 4) hull pose X_WB as estimated by navigation
    p_WN: Array  # (k, 3) [m] true nest positions in W
    hull_motion: float  # [m] largest true distance of the hull from its mean position, over the readings
    tip_spread: float  # [m] RMS of the pin's true centre about its nest's mean
    missed: int  # touches that missed their nest, left out
    simulated_s: float


class Readings:
    """Observer of the loop that collects encoder and navigation readings while the sequence holds the pin in a nest."""

    def __init__(self) -> None:
        self.q: dict[int, list[Array]] = {}
        self.X_WB: dict[int, list[Array]] = {}
        self.tip: dict[int, list[Array]] = {}
        self.hull: dict[int, list[Array]] = {}

    def observe(self, moment: Moment) -> None:
        """Appends the readings of one step to those of the present touch."""
        touch = moment.reference.touch
        if touch is None:
            return
        self.q.setdefault(touch, []).append(moment.estimate.q)
        self.X_WB.setdefault(touch, []).append(moment.estimate.X_WB)
        self.tip.setdefault(touch, []).append(np.array(moment.truth.p_WG))
        self.hull.setdefault(touch, []).append(np.array(moment.truth.p_WB))


def place_nests(vehicle: Vehicle, chain: Chain, X_WB: Array, count: int, rng: np.random.Generator) -> list[Nest]:
    """Places nests before the arm, open upwards, as far from each other as its reach allows.

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
        raise ReachError(f"the arm reaches {len(candidates)} places from enough directions; {count} nests are needed")
    chosen = [candidates[0]]
    while len(chosen) < count:
        gaps = [min(float(np.linalg.norm(c.p_WN - o.p_WN)) for o in chosen) for c in candidates]
        chosen.append(candidates[int(np.argmax(gaps))])
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class SessionSetting:
    """What is touched, how often, and how the hull is held."""

    hovering: bool  # station keeping with the thrusters; False: the hull is clamped
    nests: int
    touches: int  # of each nest
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s] steady, in W
    gust: float = 0.0  # [m/s] standard deviation of the gusts per axis


def touch(
    believed: mujoco.MjSpec,
    built: mujoco.MjSpec,
    setting: SessionSetting,
    rng: np.random.Generator,
    watch: Callable[[mujoco.MjModel], Observer] | None = None,
) -> Session:
    """Runs a touching session with the arm as built, controlled by its believed model.

    Args:
        believed: The vehicle as the controller knows it.
        built: The true vehicle; pin and nests are added to it.
        setting: Nests, touches, hull and flow.
        rng: Parent of the streams for nests, touches, gusts and sensors.
        watch: Makes a further observer of the loop for the compiled world.

    Returns:
        Readings and true figures.

    Raises:
        ReachError: The arm does not reach enough nests or directions.
    """
    own = OwnVehicle.of(believed, (CAMERA_SITE, TOOL_GEOM))
    vehicle, chain = own.vehicle, own.chain()
    X_WB = np.eye(4)
    placing, drawing, gusts, loop = rng.spawn(4)
    rig = place_nests(vehicle, chain, X_WB, setting.nests, placing)
    X_AW = inverse(X_WB @ np.array(vehicle.X_BA))
    wanted = draw_touches(chain, X_AW, rig, setting.touches, drawing, vehicle.q_ready)
    touch_rig.add_pin(built)
    touch_rig.add_nests(built, [nest.p_WN for nest in rig], [nest.z_WN for nest in rig])
    if not setting.hovering:
        touch_rig.clamp(built, X_WB)
    model = hydrodynamics.compile(built)
    flow = Current(setting.current, gust=setting.gust, timestep=model.opt.timestep, rng=gusts)
    plant = Plant(model, current=flow, X_WB=X_WB)
    parts = Parts(
        sensors=Sensing().proprioception(),
        estimator=Navigation(),
        finder=None,
        planner=TouchSequence(vehicle, chain, rig, wanted, X_WB),
        controller=CompliantTouch(own.model, clamped=not setting.hovering),
    )
    readings = Readings()
    observers: list[Observer] = [readings] if watch is None else [readings, watch(model)]
    longest = LONGEST_PER_TOUCH * (len(wanted) + 1)
    last = rollout(plant, parts, duration=longest, rng=loop, observers=observers)
    return _session(readings, wanted, rig, chain, vehicle, setting.hovering, last.truth.time)


def _session(
    readings: Readings,
    wanted: list[Touch],
    rig: list[Nest],
    chain: Chain,
    vehicle: Vehicle,
    hovering: bool,
    time: float,
) -> Session:
    series: list[list[Array]] = [[] for _ in rig]
    hulls: list[list[Array]] = [[] for _ in rig]
    tips: list[list[Array]] = [[] for _ in rig]
    places: list[Array] = []
    missed = 0
    for k in range(len(rig)):
        mine = [i for i, one in enumerate(wanted) if one.nest == k and i in readings.q]
        means = {i: np.mean(readings.q[i], axis=0) for i in mine}
        poses = {i: readings.X_WB[i][len(readings.X_WB[i]) // 2] for i in mine}
        found = {i: (poses[i] @ vehicle.X_BA @ chain.forward(means[i]))[:3, 3] for i in mine}
        middle = np.median(list(found.values()), axis=0) if found else np.zeros(3)
        for i in mine:
            ends = [chain.forward(readings.q[i][at])[:3, 3] for at in (0, -1)]
            moves = not hovering and float(np.linalg.norm(ends[1] - ends[0])) > STILL
            if moves or float(np.linalg.norm(found[i] - middle)) > MISSED:
                missed += 1
                continue
            series[k].append(means[i])
            hulls[k].append(_mean_pose(readings.X_WB[i]))
            tips[k].append(np.mean(readings.tip[i], axis=0))
            places.append(np.mean(readings.hull[i], axis=0))
    spread = np.concatenate([np.array(one) - np.mean(one, axis=0) for one in tips if one])
    return Session(
        series=tuple(np.array(one) for one in series),
        hulls=tuple(np.array(one) for one in hulls),
        p_WN=np.array([nest.p_WN for nest in rig]),
        hull_motion=float(np.linalg.norm(np.array(places) - np.mean(places, axis=0), axis=1).max()),
        tip_spread=float(np.sqrt((spread**2).sum(axis=1).mean())),
        missed=missed,
        simulated_s=time,
    )


def _mean_pose(X: list[Array]) -> Array:
    """Mean of poses that differ little: mean position, rotation projected onto SO(3)."""
    middle = np.mean(X, axis=0)
    U, _, Vt = np.linalg.svd(middle[:3, :3])
    return pose(U @ Vt, middle[:3, 3])
