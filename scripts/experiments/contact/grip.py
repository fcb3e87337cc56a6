"""Grip: what a gripper holds, how fast it creeps out, and where it slips, by setting of the solver.

The pads close on an object of 2 kg, 9.8 N in water, with 40 N at a friction of 0.6. It is held for
a minute, pulled across the jaws and out of them, and turned about their axis, by a load that grows
steadily. The limits are those of the friction cone: 2 mu N of a force, and of a moment, with points
at distance r from the axis and the moment mu_t N that a soft pad bears about each, 2 N
sqrt((mu r)^2 + mu_t^2). The hand is fixed; in the last table a vehicle adrift holds the object.
Its arm is held with a damping of 0.02 s times the stiffness: with the 0.03 s of `ArmHold` the small
arm reverses its torque in each step of 2 ms, and shakes the object out.
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.experiment.statistic import Statistic
from uuv.models import hydrodynamics as water
from uuv.models.naming import READY_KEY, TIP_SITE
from uuv.models.site.grip_contact import let_gripper_hold
from uuv.models.tools.gripper import FINGERS, MOTOR, PADS, Gripper, add_gripper
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import GRAVITY, Array, finite_number, log_so3
from uuv.sim.interfaces.streams import Streams
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

OBJECT = "gripped"
MASS = 2.0  # [kg]
WEIGHT = 9.8  # [N] in water
BOX = np.array([0.02, 0.03, 0.05])  # [m] half sides: across the pads, along the tool, along a pad
_HALF_SIDES = BOX[[0, 2, 1]]  # [m] along x, y, z of the body: z is along the tool
CYLINDER = 0.025, 0.05  # [m] radius and half length, along the pads' breadth
SPHERE = 0.025  # [m] radius
HALF = {"box": BOX[0], "cylinder": CYLINDER[0], "sphere": SPHERE}  # [m] across the pads
PLACE = 0.035  # [m] from the fingers' ends to the middle of the object
# Mean speeds over WINDOW from which it slips: four times the creep, above a step's jitter.
WINDOW = 0.1  # [s]
SLIPS = 4e-4  # [m/s]
TURNS = 2e-2  # [rad/s]
# The load grows from BELOW to BEYOND of the expected one, slowly: pads that slide part, and the
# motor yields slowly, so that a fast load finds more than what is held for long.
BELOW = 0.9  # share
BEYOND = 1.1  # share
SETTLE = 2.0  # [s] to close, without weight
ARM_DAMPING = 0.02  # [s] damping of the held arm over its stiffness
# Cones and impratio; None: as `let_gripper_hold` sets them.
SETTINGS = {
    "pyramidal, 1": (mujoco.mjtCone.mjCONE_PYRAMIDAL, 1.0),
    "pyramidal, 100": (mujoco.mjtCone.mjCONE_PYRAMIDAL, 100.0),
    "elliptic, 1": (mujoco.mjtCone.mjCONE_ELLIPTIC, 1.0),
    "elliptic, 10": (mujoco.mjtCone.mjCONE_ELLIPTIC, 10.0),
    "elliptic, 100": (mujoco.mjtCone.mjCONE_ELLIPTIC, 100.0),
    "computed": None,
}
COMPUTED = "computed"
HOLD = "hold"
ACROSS = "pull across"
OUT = "pull out"
TURN = "turn"
DRIFT = "drift"
TRIALS = HOLD, ACROSS, OUT, TURN, DRIFT
VEHICLES = {"uuv_puma": "gripper", "bluerov2_heavy_alpha5": "small_gripper"}


@dataclass(frozen=True, kw_only=True)
class GripCase:
    """One trial with one object and one setting of the solver."""

    trial: str
    """What is done with the object."""
    shape: str
    """Shape of the object."""
    setting: str
    """Cones and impratio."""
    vehicle: str
    """Vehicle that drifts with the object."""
    force: float = 40.0
    """Force of the motor on each finger [N]."""
    duration: float = 60.0
    """How long the object is held [s]."""
    ramp: float = 20.0
    """Time in which a pull or a turn grows from 0.9 to 1.1 of the friction cone [s]."""
    timestep: float = 0.002
    """Timestep of the fixed hand [s]."""
    seed: int = 0
    """Seed of the gusts in which a vehicle drifts."""

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a trial that cannot be run."""
        at_least(self, seed=0)
        finite_number(self.force, "--force", above=0.0)
        finite_number(self.duration, "--duration", least=WINDOW)
        finite_number(self.ramp, "--ramp", least=4.0 * WINDOW)
        finite_number(self.timestep, "--timestep", above=0.0, most=WINDOW)


@dataclass(frozen=True, kw_only=True)
class GripRow:
    """What the object did, and what a step cost."""

    kept: bool = column("still held")
    creep: float | None = column("creep", "mm", digits=3, factor=1e3, default=None)
    limit: float | None = column("slips at", "N, N m", digits=3, default=None)
    cone: float | None = column("friction cone", "N, N m", digits=3, default=None)
    off: float | None = column("off the cone", "%", digits=2, factor=100.0, default=None)
    step: float = column("time of a step", "us", digits=0, factor=1e6, tolerance=None)
    without: float | None = column(
        "without an object", "us", digits=0, factor=1e6, tolerance=None, default=None
    )
    iterations: float = column("iterations of the solver", digits=2)


def cases(case: GripCase) -> Iterator[GripCase]:
    """The case; vehicles drift with the computed setting and the box, and matter to no other."""
    if case.trial == DRIFT:
        if case.setting == COMPUTED and case.shape == "box":
            yield case
    elif case.vehicle == next(iter(VEHICLES)):
        yield case


@experiment(
    "grip",
    vary={
        "trial": TRIALS,
        "shape": tuple(HALF),
        "setting": tuple(SETTINGS),
        "vehicle": tuple(VEHICLES),
    },
    cases=cases,
    quick={"trial": (HOLD, ACROSS, OUT, TURN), "setting": ("elliptic, 100", COMPUTED)},
)
def grip(case: GripCase) -> GripRow:
    """Grips an object, and holds, pulls or turns it."""
    if case.trial == DRIFT:
        return _drift(case)

    hand = Hand(case)
    if case.trial == HOLD:
        hand.load(np.array([0.0, 0.0, -WEIGHT]), np.zeros(3))
        begin = hand.place()
        steps = hand.advance(round(case.duration / case.timestep))
        holds = hand.held()
        return GripRow(
            kept=holds,
            creep=float(np.linalg.norm(hand.place() - begin)) if holds else None,
            step=steps.time,
            iterations=steps.iterations,
        )
    return _slip(hand, case)


def _slip(hand: "Hand", case: GripCase) -> GripRow:
    """Row of a load that grows until the object slips or falls."""
    cone = hand.cone(case.trial)
    axis = {ACROSS: [0.0, 0.0, -1.0], OUT: [1.0, 0.0, 0.0], TURN: [0.0, 1.0, 0.0]}[case.trial]
    turning = case.trial == TURN

    count = round(case.ramp / case.timestep)
    window = round(WINDOW / case.timestep)
    slips = TURNS if turning else SLIPS
    begin = hand.turn() if turning else hand.place()
    limit: float | None = None
    slipped = False
    costs = []
    for step in range(0, count, window):
        load = (BELOW + (BEYOND - BELOW) * step / count) * cone * np.array(axis)
        hand.load(*((np.zeros(3), load) if turning else (load, np.zeros(3))))
        costs.append(hand.advance(window))

        end = hand.turn() if turning else hand.place()
        moved = angle_of(begin.T @ end) if turning else float(np.linalg.norm(end - begin))
        begin = end
        # the first window takes up what is elastic
        if step and moved > slips * WINDOW:
            slipped = True
            limit = float(np.linalg.norm(load)) if step > window else None
            break

    return GripRow(
        kept=not slipped,
        limit=limit,
        cone=cone,
        # None: it slipped at once, or not at all
        off=None if limit is None else abs(limit / cone - 1.0),
        step=float(np.mean([cost.time for cost in costs])),
        iterations=float(np.mean([cost.iterations for cost in costs])),
    )


def angle_of(R: Array) -> float:
    """Angle [rad] of a rotation (3, 3)."""
    return float(np.linalg.norm(log_so3(R)))


@dataclass(frozen=True)
class StepCost:
    """Means over some steps."""

    time: float  # [s]
    iterations: float


class Hand:
    """A fixed gripper that has closed on a weightless object; its tool points along x of W, its
    closing axis along y.
    """

    def __init__(self, case: GripCase) -> None:
        """Build the scene of a case, and close."""
        spec = mujoco.MjSpec()
        spec.option.timestep = case.timestep
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.gravity = [0.0, 0.0, 0.0]
        hand = spec.worldbody.add_body(name="hand", pos=[0.3, 0.2, 1.0], quat=[0.5] * 4)
        tip = hand.add_site(name=TIP_SITE)
        gripper = Gripper()
        add_gripper(spec, hand, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), tip, gripper)

        along = gripper.length - PLACE
        add_object(spec, case.shape, np.array([0.3 + along, 0.2, 1.0]), np.array([0.5] * 4))
        let_gripper_hold(spec, OBJECT)
        setting = SETTINGS[case.setting]
        if setting is not None:
            spec.option.cone, spec.option.impratio = setting

        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        _close(self.model, self.data, case)
        self._force = case.force
        self.advance(round(SETTLE / case.timestep))

    def load(self, force: Array, moment: Array) -> None:
        """Set force (3,) [N] and moment (3,) [N m] in W on the object."""
        self.data.body(OBJECT).xfrc_applied = np.concatenate([force, moment])

    def advance(self, count: int) -> StepCost:
        """Take `count` steps."""
        iterations = 0
        begin = time.perf_counter()
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            iterations += int(self.data.solver_niter[0])
        return StepCost((time.perf_counter() - begin) / count, iterations / count)

    def place(self) -> Array:
        """Position (3,) [m] of the object from the left finger, in W."""
        return self.data.body(OBJECT).xpos - self.data.body(FINGERS[0]).xpos

    def turn(self) -> Array:
        """Orientation (3, 3) of the object in W."""
        return self.data.body(OBJECT).xmat.reshape(3, 3).copy()

    def points(self) -> Array:
        """Contact points (k, 3) [m] of the first pad with the object, in W."""
        pad = self.model.geom(PADS[0]).id
        at_pad = np.any(self.data.contact.geom == pad, axis=1)
        return self.data.contact.pos[at_pad]

    def held(self) -> bool:
        """Whether the object is between the pads."""
        return len(self.points()) > 0

    def cone(self, trial: str) -> float:
        """Force [N] or moment [N m] at which the object slips, of the friction cone."""
        sliding, _, turning = self.model.pair_friction[0, :3]
        if trial != TURN:
            return 2.0 * float(sliding) * self._force

        # Equal loads on the points of a pad, which turn about the middle of them.
        points = self.points()
        r = np.linalg.norm((points - points.mean(axis=0))[:, [0, 2]], axis=1)
        return 2.0 * self._force * float(np.mean(np.hypot(sliding * r, turning)))


def _close(model: mujoco.MjModel, data: mujoco.MjData, case: GripCase) -> None:
    """Let the jaws close, from just open enough for the object.

    Raises:
        ConfigurationError: the motor has less than the force of the case.
    """
    most = float(model.actuator(MOTOR).ctrlrange[1])
    if case.force > most:
        raise ConfigurationError(f"--force must be at most {most:g} N, got {case.force:g} N")

    for name in FINGERS:
        data.joint(name).qpos = HALF[case.shape] + 1e-4
    data.actuator(MOTOR).ctrl = -case.force


def _drift(case: GripCase) -> GripRow:
    """Row of a vehicle that drifts in gusts, its arm held, with the box or with nothing.

    Raises:
        ConfigurationError: another object than the box, or another setting than the computed one.
    """
    if case.shape != "box" or case.setting != COMPUTED:
        raise ConfigurationError(
            f"a vehicle drifts with the box and the setting {COMPUTED!r} only, "
            f"got {case.shape}, {case.setting}"
        )

    drifts = [_adrift(case, held=held) for held in (False, True)]
    (bare, _, _), (step, creep, holds) = drifts
    return GripRow(
        kept=holds,
        creep=creep if holds else None,
        step=step.time,
        without=bare.time,
        iterations=step.iterations,
    )


def _adrift(case: GripCase, *, held: bool) -> tuple[StepCost, float, bool]:
    """Cost of a step, motion [m] of the object in the jaws, and whether it is there in the end."""
    spec = vehicle_spec(case.vehicle, tool=VEHICLES[case.vehicle])
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(READY_KEY).id)
    mujoco.mj_kinematics(model, data)
    if held:
        tip = data.site(TIP_SITE)
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, tip.xmat)
        z = tip.xmat.reshape(3, 3)[:, 2]
        add_object(spec, case.shape, tip.xpos - PLACE * z, quat)
        water.attach(spec, {OBJECT: water_of_box(water.density_of(spec))})
        let_gripper_hold(spec, OBJECT)

    model = hydrodynamics.compile(spec)
    gusts = Streams(case.seed)["gusts"]
    dt = float(model.opt.timestep)
    plant = Plant(model, current=Current([0.1, 0.05, 0.0], gust=0.05, timestep=dt, rng=gusts))
    hold = ArmHold(plant.vehicle, plant.vehicle.q_ready, ARM_DAMPING)
    data = plant.data
    data.qpos[plant.vehicle.qpos] = plant.vehicle.q_ready
    _close(model, data, case)

    def place() -> Array:
        finger = data.body(FINGERS[0])
        return finger.xmat.reshape(3, 3).T @ (data.body(OBJECT).xpos - finger.xpos)

    still = np.zeros(len(plant.vehicle.thruster_names))
    settle = round(SETTLE / dt)
    count = round((SETTLE + case.duration) / dt)
    begin = np.zeros(3)
    elapsed = 0.0
    iterations = 0
    truth = plant.observe()
    for step in range(count):
        torque = hold.torque(truth)
        start = time.perf_counter()
        plant.step(Command(time=truth.time, joint_torque=torque, thrusters=still, scan=False))
        truth = plant.observe()
        elapsed += time.perf_counter() - start
        iterations += int(data.solver_niter[0])
        if held and step == settle:
            begin = place()

    moved = float(np.linalg.norm(place() - begin)) if held else 0.0
    touches = held and truth.contact_normal > 0.0
    return StepCost(elapsed / count, iterations / count), moved, touches


def water_of_box(density: float) -> water.BodyHydrodynamics:
    """Water of the box in the frame of its body, at `density` [kg/m^3].

    Added mass and drag are those of its sides. Its displacement is four times that of the sides, so
    that 2 kg weigh WEIGHT in water, as on the fixed hand.
    """
    of_sides = water.box(tuple(2.0 * _HALF_SIDES), water_density=density)
    return replace(of_sides, volume=(MASS - WEIGHT / GRAVITY) / density)


def add_object(spec: mujoco.MjSpec, shape: str, p_WO: Array, quat_wxyz: Array) -> None:
    """Add the free object at `p_WO` (3,) [m], its x across the pads and its z along the tool."""
    body = spec.worldbody.add_body(name=OBJECT, pos=p_WO, quat=quat_wxyz)
    body.add_freejoint()
    touches = {"mass": MASS, "contype": 2, "conaffinity": 1}
    if shape == "box":
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=_HALF_SIDES, **touches)
    elif shape == "cylinder":
        along = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])  # y of the tool
        size = [*CYLINDER, 0.0]
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=size, quat=along, **touches)
    else:
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[SPHERE, 0.0, 0.0], **touches)


def _computed(name: str) -> Statistic:
    """Largest value of a column among the runs with the computed setting."""
    return stat("largest", lambda row: row[name] if row["setting"] == COMPUTED else None, name)


def _dropped(row: Mapping[str, Any]) -> bool | None:
    """Whether the computed setting has dropped what was to be held; None for another trial."""
    holds = row["trial"] in (HOLD, DRIFT) and row["setting"] == COMPUTED
    return not row["kept"] if holds else None


def _without_limit(row: Mapping[str, Any]) -> bool | None:
    """Whether no limit was measured with the computed setting; None for another trial."""
    slips = row["trial"] in (ACROSS, OUT, TURN) and row["setting"] == COMPUTED
    return row["limit"] is None if slips else None


grip.page = (
    Page()
    .table(
        "Creep of the object in a minute [mm]",
        by="setting",
        across="shape",
        columns=["creep"],
        where=lambda row: row["trial"] == HOLD,
    )
    .table(
        "Held for a minute: creep, and cost of a step",
        by=("shape", "setting"),
        columns=["kept", "creep", "step", "iterations"],
        where=lambda row: row["trial"] == HOLD,
    )
    .table(
        "Load at which the object slips, against the friction cone",
        by=("trial", "shape", "setting"),
        columns=["limit", "cone", "off"],
        where=lambda row: row["trial"] in (ACROSS, OUT, TURN),
    )
    .table(
        "Vehicle adrift for a minute, with the object in its jaws",
        by="vehicle",
        columns=["kept", "creep", "step", "without", "iterations"],
        where=lambda row: row["trial"] == DRIFT,
    )
    .accept(stat("count", _dropped, "dropped"), most=0)
    .accept(_computed("creep"), most=0.002)
    .accept(stat("count", _without_limit, "without a measured limit"), most=0)
    .accept(_computed("off"), most=0.02)
)

if __name__ == "__main__":
    run_scenario(grip.main)
