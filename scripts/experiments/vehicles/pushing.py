"""Station keeping while the tool is pushed: realistic thrusters and navigation, a stiff arm at full
reach.

The push is an external force at the tip. Springs in the joints replace the drives, so that the
figures show the hull alone. The felt force is the true force with the lag and noise of an estimate
from the arm's torques.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import mujoco
import numpy as np

from uuv.assembly import assemble
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.hull_control import HullControl
from uuv.controllers.hull.priorities import PRIORITIES
from uuv.controllers.hull.thruster_lead import ThrusterLead
from uuv.controllers.tuning import HULL
from uuv.models.naming import CAMERA_SITE, HOME_KEY, TOOL_GEOM
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.own_vehicle import OwnVehicle
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.runner import run_through
from uuv.scenario import PlacedTask, Scenario, Task, VehicleSetup
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, Target, WorkState
from uuv.sim.interfaces.spatial import Array, rotation_angle, skew
from uuv.sim.loop.rollout import Moment
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.truth import Truth
from uuv.site import OpenWater, Site

FELT_LAG = 0.012  # [s] time constant of the felt force
FELT_NOISE = 0.01  # standard deviation, share of the reading
FELT_BIAS = 0.5  # [N] standard deviation of the bias of the felt force per axis
HOLD = 60.0  # [rad/s] natural frequency of the springs in the joints
PERIOD = 0.02  # [s] of station keeping


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PushCase:
    """One vehicle in one current, pushed in several directions one after the other."""

    directions_B: Array  # (k, 3) unit vectors of the force on the tip, in B
    q: Array  # (n,) [rad] posture of the arm
    vehicle: str = "uuv_puma"
    force: float = 90.0  # [N]
    rise: float = 0.1  # [s] ramp of the push, up and down
    push: float = 5.0  # [s] duration of a push
    rest: float = 4.0  # [s] pause after a push
    settle: float = 15.0  # [s] before the first push
    current_W: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s] steady
    gust: float = 0.0  # [m/s] standard deviation per axis
    # [s] lag of the thrusters, known to the controller; None: the vehicle's
    lag: float | None = None
    # dead band of the thrusters, known to the controller; None: the vehicle's
    dead_band: float | None = None
    water_error: float = 0.15  # share by which the controller's coefficients are wrong
    lag_error: float = 0.0  # share by which the controller's lag is wrong
    compensation: bool = True  # feed the arm's wrench forward
    response: float = HULL.response  # [s] response of the thruster lead; np.inf: no lead
    priorities: Sequence[Sequence[str]] = PRIORITIES
    lost: int | None = None  # index of the thruster that stops in the middle of the first push
    noticed: float = np.inf  # [s] after which the allocation excludes it
    seed: int = 0

    @property
    def thruster(self) -> dict[str, float]:
        """Fields of every thruster that the case changes."""
        settings = {"time_constant": self.lag, "dead_band": self.dead_band}
        return {name: number for name, number in settings.items() if number is not None}


@dataclass(slots=True, eq=False)
class PushFigures:
    """Figures of a case, one entry for each push."""

    # (k,) [m] largest distance of the hull from its position at the push's begin, until the next
    # push
    excursion: Array
    tilt: Array  # (k,) [rad] largest tilt of the hull's z axis, over the same time
    turn: Array  # (k,) [rad] largest rotation, yaw included, over the same time
    saturated: Array  # (k,) share of the push during which thrusters saturate
    # (k,) [N] RMS of the thrusters' force against the push, over its first second
    force_error: Array
    current_error: Array  # (k, 3) [m/s] RMS error of the estimated current during the push, in B
    command_rate: float  # [1/s] RMS rate of the thruster commands without a push


@dataclass(slots=True, eq=False)
class TipPush:
    """The push as it is now; the judge sets it, plant and controller read it."""

    force_W: Array = field(default_factory=lambda: np.zeros(3))
    dead: int | None = None  # index of a thruster that has stopped
    truth: Truth | None = None  # of the pushed plant, which sets it


class PushedPlant:
    """Plant (`uuv.sim.loop.rollout.SteppedPlant`) with an external force at the tip, and a thruster
    that may stop.
    """

    def __init__(self, plant: Plant, push: TipPush) -> None:
        self.plant = plant
        self.push = push
        self.timestep = plant.timestep
        push.truth = plant.truth

    def observe(self) -> Truth:
        """As `Plant.observe`."""
        return self.plant.observe()

    def step(self, command: Command) -> None:
        """Applies the push, zeroes a stopped thruster, and steps the plant."""
        plant = self.plant
        push = self.push

        plant.data.qfrc_applied[:] = 0.0
        if push.force_W.any():
            body = int(plant.model.site_bodyid[plant.vehicle.tip])
            applied = plant.data.qfrc_applied
            mujoco.mj_applyFT(
                plant.model, plant.data, push.force_W, np.zeros(3), plant.truth.p_WG, body, applied
            )

        if push.dead is not None:
            thrust = command.thrusters.copy()
            thrust[push.dead] = 0.0
            command = replace(command, thrusters=thrust)

        plant.step(command)


@dataclass(frozen=True, kw_only=True)
class _PushOnTip(Perturbation):
    """The push on the tip, and the loss of a thruster."""

    push: TipPush

    def on_loop(self, loop: Loop) -> Loop:
        """Wraps the plant."""
        assert isinstance(loop.plant, Plant)
        return replace(loop, plant=PushedPlant(loop.plant, self.push))


class HullController:
    """Controller of the hull alone (`uuv.sim.interfaces.protocols.Controller`)."""

    period = PERIOD

    def __init__(
        self, case: PushCase, model: mujoco.MjModel, push: TipPush, rng: np.random.Generator
    ) -> None:
        self._case = case
        self._push = push
        self._rng = rng

        self._vehicle = vehicle = Vehicle.of(model)
        self._arm = ArmDynamics(model, water_error=case.water_error)
        self._model = model

        self._hull = self._control(Allocation(vehicle, priorities=case.priorities))
        self.state = self._hull.init()
        self._lost: tuple[int, ...] = ()  # thrusters that the controller knows to be lost

        # The felt force has a bias that stays.
        self._bias = FELT_BIAS * rng.standard_normal(3)
        self._home = self._arm.wrench_at_rest(np.array(vehicle.q_home))
        self.felt_W = np.zeros(3)
        self._w_last_B = np.zeros(3)

    def _control(self, allocation: Allocation) -> HullControl:
        case = self._case
        return HullControl(
            self._model,
            self._arm,
            period=PERIOD,
            water_error=case.water_error,
            allocation=allocation,
            lead=ThrusterLead(
                self._vehicle, response=min(case.response, 1e6), lag_error=case.lag_error
            ),
        )

    def exclude(self, thruster: int) -> None:
        """Leaves a lost thruster out of the allocation from now on."""
        self._lost = (thruster,)

    def init(self, estimate: StateEstimate):
        """Resets the state of the hull's loop."""
        self.state = self._hull.init()
        return self

    def step(self, state, estimate: StateEstimate, reference: Reference):
        """Thruster command for the reference pose of the hull; joint torques are zero.

        Args:
            state: Unused; this object keeps its state itself.
            estimate: State estimate of the vehicle.
            reference: Reference; its X_WB is used.

        Returns:
            State, command.
        """
        case = self._case
        truth = self._push.truth
        assert truth is not None
        R_WB = estimate.X_WB[:3, :3]

        # The felt force lags, and its noise grows with it.
        share = 1.0 - np.exp(-PERIOD / FELT_LAG)
        self.felt_W += share * (self._push.force_W - self.felt_W)
        noise = FELT_NOISE * np.abs(self.felt_W) * self._rng.standard_normal(3)

        turning = (estimate.w_WB_B - self._w_last_B) / PERIOD
        self._w_last_B = np.array(estimate.w_WB_B)

        # Wrench of the arm on the hull by its model, and of the felt force at the tip.
        arm_B = self._arm.inverse(
            estimate.q,
            estimate.qd,
            np.zeros(len(estimate.q)),
            R_WB=R_WB,
            nu_B=np.concatenate([estimate.v_WB_B, estimate.w_WB_B]),
            a_B=np.concatenate([estimate.a_WB_B, turning]),
            v_current_W=self.state.current_W,
            wrench_tip_G=np.zeros(6),
        )[1]

        tip_B = truth.R_WB.T @ (np.array(truth.p_WG) - truth.p_WB)
        f_B = R_WB.T @ (self.felt_W + noise + (self._bias if self.felt_W.any() else 0.0))
        arm_B += np.concatenate([f_B, skew(tip_B) @ f_B])

        fed = arm_B if case.compensation else self._home
        reference = replace(reference, lost_thrusters=self._lost)
        command = self._hull.step(self.state, estimate, reference, fed)

        rest = np.zeros(len(estimate.q))
        return state, Command(time=estimate.time, joint_torque=rest, thrusters=command, scan=False)


class StayPut:
    """Planner (`uuv.sim.interfaces.protocols.Planner`) with a constant reference: hull at W's
    origin, fixed posture.
    """

    period = PERIOD

    def __init__(self, q: Array) -> None:
        self._q = q

    def init(self, estimate: StateEstimate) -> Array:
        """Pose of the hull to keep: the origin of W."""
        return np.eye(4)

    def step(
        self, state: Array, estimate: StateEstimate, target: Target | None, last: Command | None
    ):
        """The constant reference.

        Args:
            state: (4, 4) pose X_WB to keep.
            estimate: State estimate; its time is used.
            target: Unused.
            last: Unused.

        Returns:
            State, reference.
        """
        return state, Reference.holding(estimate.time, state, self._q, state=WorkState.WORK)


def holdable_directions(
    vehicle: Vehicle, arm: ArmDynamics, q: Array, directions_B: Array, force: float
) -> np.ndarray:
    """Directions in which the drives can hold a static force on the tip.

    Args:
        vehicle: The vehicle, with its torque limits.
        arm: Dynamics of its arm.
        q: (n,) [rad] posture.
        directions_B: (k, 3) unit vectors of the force, in B.
        force: [N].

    Returns:
        (k,) bool.
    """
    rest = np.zeros(len(q))
    still = {"R_WB": np.eye(3), "nu_B": np.zeros(6), "a_B": np.zeros(6), "v_current_W": np.zeros(3)}

    held = []
    for direction in directions_B:
        pushed = []
        for axis in np.eye(3):  # axes of G; the torques are linear in the force
            pushed.append(
                arm.inverse(q, rest, rest, wrench_tip_G=np.concatenate([axis, rest[:3]]), **still)[
                    0
                ]
            )

        free = arm.inverse(q, rest, rest, wrench_tip_G=np.zeros(6), **still)[0]
        R_BG = arm.tip(q)[0][:3, :3]
        tau = free + force * (np.array(pushed) - free).T @ (R_BG.T @ direction)
        held.append(bool(np.all(np.abs(tau) <= vehicle.torque_limits)))

    return np.array(held)


@dataclass(frozen=True, kw_only=True, eq=False)
class _PushTask(Task):
    """Keep station while the tip is pushed; no key of a scenario's file."""

    spares: ClassVar[Collection[str]] = (CAMERA_SITE, TOOL_GEOM)
    case: PushCase
    push: TipPush
    felt: np.random.Generator  # of bias and noise of the felt force

    def place(self, scenario: Scenario, own: OwnVehicle, rng: np.random.Generator) -> "PlacedPush":
        """Station keeping at W's origin; the controller knows the thrusters of the case."""
        rows = own.model.actuator_user
        for index in own.vehicle.thruster_actuators:
            rows[index] = thrusters.changed(rows[index], **self.case.thruster)

        return PlacedPush(
            task=self, own=own, keeper=HullController(self.case, own.model, self.push, self.felt)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedPush(PlacedTask):
    """Station keeping at W's origin, springs in the joints."""

    exact_start: ClassVar[bool] = True
    task: _PushTask
    own: OwnVehicle
    keeper: HullController

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Station keeping under pushes of {self.task.case.force:g} N"

    @property
    def X_WB(self) -> Array:
        """Pose of the hull: the origin of W."""
        return np.eye(4)

    def scene(self, vehicle: mujoco.MjSpec) -> mujoco.MjSpec:
        """Springs hold the joints at the posture, where the arm also starts; the thrusters are
        those of the case.
        """
        # [kg m^2] of the order of the arm's inertia about any joint
        case = self.task.case
        inertia = 5.0
        home = next(key for key in vehicle.keys if key.name == HOME_KEY)
        for name, address, q in zip(
            self.own.vehicle.joint_names, self.own.vehicle.qpos, case.q, strict=True
        ):
            joint = vehicle.joint(name)
            joint.stiffness[0] = inertia * HOLD**2
            joint.damping[0] = 2.0 * inertia * HOLD
            joint.springref = home.qpos[address] = q

        for actuator in vehicle.actuators:
            if thrusters.carries(np.array(actuator.userdata)):
                row = np.array(actuator.userdata)
                actuator.userdata = thrusters.changed(row, **case.thruster)

        return vehicle

    def planner(self) -> StayPut:
        """The posture of the case, at the origin."""
        return StayPut(self.task.case.q)

    def controller(self) -> HullController:
        """Controller of the hull alone."""
        return self.keeper


def run(case: PushCase) -> PushFigures:
    """Simulates a case and returns its figures."""
    push = TipPush()
    _, felt, sensors = np.random.default_rng(case.seed).spawn(3)
    scenario = Scenario(
        name="pushing",
        task=_PushTask(case=case, push=push, felt=felt),
        seed=case.seed,
        site=Site(object=OpenWater(), current=case.current_W, gust=case.gust),
        vehicle=VehicleSetup(vehicle=case.vehicle),
        perturbations=(_PushOnTip(push=push),),
    )
    # a stream of its own beside the felt force's
    assembly = replace(assemble(scenario), noise=sensors)
    assert isinstance(assembly.placed, PlacedPush)

    k = len(case.directions_B)
    every = case.push + case.rest
    pushed = PushFigures(
        excursion=np.zeros(k),
        tilt=np.zeros(k),
        turn=np.zeros(k),
        saturated=np.zeros(k),
        force_error=np.zeros(k),
        current_error=np.zeros((k, 3)),
        command_rate=0.0,
    )

    judge = _Judge(case, assembly.plant, push, assembly.placed.keeper, pushed)
    run_through(
        assembly, observers=[judge], longest=round((case.settle + k * every) / PERIOD) * PERIOD
    )

    return judge.done()


class _Judge:
    """Observer that applies the pushes and computes the figures from the truth."""

    def __init__(
        self,
        case: PushCase,
        plant: Plant,
        push: TipPush,
        keeper: HullController,
        pushed: PushFigures,
    ) -> None:
        self._case = case
        self._plant = plant
        self._push = push
        self._keeper = keeper
        self._pushed = pushed

        self._start = (np.zeros(3), np.eye(3))
        self._at = -1
        self._B = plant.vehicle.thruster_wrench
        self._force = []
        self._current = []
        self._rates = []
        self._before_B = np.zeros(3)
        self._last = np.zeros(0)
        self._ticks = 0

    def observe(self, moment: Moment) -> None:
        case = self._case
        truth = self._plant.truth
        pushed = self._pushed
        since = truth.time - case.settle
        at, inside = divmod(since, case.push + case.rest)
        at = int(at)
        rising = 0.0

        if since >= 0.0 and at < len(case.directions_B):
            if at != self._at:
                self._next(at, truth)
            rising = float(np.clip(min(inside, case.push - inside) / case.rise, 0.0, 1.0))

            p, R = self._start
            pushed.excursion[at] = max(pushed.excursion[at], float(np.linalg.norm(truth.p_WB - p)))
            pushed.turn[at] = max(pushed.turn[at], rotation_angle(R, truth.R_WB))
            pushed.tilt[at] = max(
                pushed.tilt[at], float(np.arccos(np.clip(R[:, 2] @ truth.R_WB[:, 2], -1.0, 1.0)))
            )

            if inside < case.push:
                pushed.saturated[at] += truth.saturated * self._plant.timestep / case.push
                error_W = self._keeper.state.current_W - truth.current_W
                self._current.append((truth.R_WB.T @ error_W) ** 2)

            if inside < 1.0:
                given_B = self._B[:3] @ truth.thrust - self._before_B
                self._force.append(
                    np.sum((given_B + rising * case.force * case.directions_B[at]) ** 2)
                )

            # The controller learns of a lost thruster some time after the loss.
            if case.lost is not None and at == 0 and inside >= 0.5 * case.push:
                self._push.dead = case.lost
                if inside >= 0.5 * case.push + case.noticed:
                    self._keeper.exclude(case.lost)
        elif since > -5.0 and moment.tick % 10 == 0:
            # Before the first push: how much the commands change.
            thrust = np.array(moment.command.thrusters)
            if len(self._last):
                self._rates.append(np.mean((thrust - self._last) ** 2) / PERIOD**2)
            self._last = thrust

        direction = case.directions_B[min(max(at, 0), len(case.directions_B) - 1)]
        self._push.force_W = rising * case.force * (truth.R_WB @ direction)

    def _next(self, at: int, truth: Truth) -> None:
        self._close()
        self._at = at
        self._start = (np.array(truth.p_WB), np.array(truth.R_WB))
        self._before_B = self._B[:3] @ np.array(truth.thrust)

    def _close(self) -> None:
        if self._at >= 0:
            self._pushed.force_error[self._at] = np.sqrt(np.mean(self._force))
            self._pushed.current_error[self._at] = np.sqrt(np.mean(self._current, axis=0))
        self._force = []
        self._current = []

    def done(self) -> PushFigures:
        self._close()
        self._pushed.command_rate = float(np.sqrt(np.mean(self._rates))) if self._rates else 0.0
        return self._pushed
