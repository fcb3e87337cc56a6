"""Station keeping in the check, ten seconds or until rest, with the truth as the estimate."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.hull_control import HullControl
from uuv.controllers.tasks.hull_phases import RestLimits
from uuv.models.files.holding import TURNING, hold
from uuv.models.naming import ARM_BASE_BODY, HOME_KEY, TIP_SITE
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.messages import Command, Reference
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.true_estimate import true_estimate
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.supply import ENERGY
from uuv.sim.plant.truth import Truth
from uuv.sim.water.current import Current

SECONDS = 10.0  # simulated
_PERIOD = 0.02  # [s] period of station keeping
_LATE = 0.5  # share of the time after which a vehicle should be at rest
_HERE = np.eye(4)  # X_WB to hold
_WINDOW = 5.0  # [s] after which a hull that does not rest yet must turn more slowly than before,
_SLOWER = 0.95  # by this factor
_LOST = 50.0  # [m] from the pose to hold, at which the simulation ends


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverFigures:
    """Figures of station keeping over the check's time; drift and tilt over its last half."""

    drift: float  # [m] largest distance from the position to hold
    tilt: float  # [rad] largest tilt of the hull
    saturated: float  # share of the time at which a thruster was at its limit
    rest: float = 0.0  # [s] longest time at rest, which a job requires before it begins
    turn: float = 0.0  # [rad/s] largest rate of the hull over the last half
    # [W] mean electrical power of the thrusters; None: their current was not measured
    power: float | None = None
    # [m] largest motion of any point of the vehicle from its place, the arm's sag included
    swing: float = 0.0
    said: str = ""  # what broke it off


def hover(
    model: mujoco.MjModel,
    current_W: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    until_rest: float = 0.0,
) -> HoverFigures:
    """Keep station at the origin, with the arm held at home by its drives.

    Args:
        model: Compiled by `uuv.sim.hydrodynamics.compile`, with thrusters that span all directions.
        current_W: (3,) [m/s] steady current.
        until_rest: [s] for how long to wait for rest after SECONDS, as long as the hull calms down:
            without thrust about an axis, only its drag damps it.

    Raises:
        UuvError: The vehicle cannot be controlled at all.
    """
    plant = Plant(model, current=Current(np.array(current_W)))
    vehicle = plant.vehicle
    true = plant.observe()

    # The arm holds its home posture; its weight is fed forward to the hull's control.
    q, none = np.array(vehicle.q_home), np.zeros(len(vehicle.joints))
    armed = len(vehicle.joints) > 0
    hold = ArmHold(vehicle, q) if armed else None
    arm_B = ArmDynamics(model).wrench_at_rest(q) if armed else np.zeros(6)

    control = HullControl(model, period=_PERIOD)
    state = control.init()
    ticks = max(1, round(_PERIOD / plant.timestep))

    watch = _Watch(plant, q, ticks * plant.timestep)
    thrusters = np.zeros(len(vehicle.thruster_names))

    try:
        for tick in range(round(max(SECONDS, until_rest) / plant.timestep)):
            if true.time >= SECONDS and watch.ends(true.time):
                break
            if tick % ticks == 0:
                estimate = true_estimate(true)
                thrusters = control.step(
                    state, estimate, Reference.holding(true.time, _HERE, q), arm_B
                )

            torque = none if hold is None else hold.torque(true)
            plant.step(
                Command(time=true.time, joint_torque=torque, thrusters=thrusters, scan=False)
            )
            plant.observe()
            if (tick + 1) % ticks == 0:
                watch.see(true)
                if not watch.away < _LOST:
                    return watch.broken_off("it drifted away", watch.away)
    except HydrodynamicsError as error:
        return watch.broken_off(str(error), np.inf)
    return watch.figures()


class _Watch:
    """Figures of station keeping, taken in every period of control."""

    def __init__(self, plant: Plant, q: Array, period: float) -> None:
        """Take the plant, the posture (n,) that its arm is to hold, and the period [s]."""
        self._plant = plant
        self._period = period
        self._q = q
        self._radius = _radius(plant)
        self._limits = RestLimits()
        self._steps = self._saturated = 0
        self._drift = self._tilt = self._turn = self._rest = self._quiet = self._swing = 0.0
        self.away = 0.0  # [m] of the hull from its place
        # [rad/s] largest rate of the hull in the present window, and in the one before
        self._rates = [0.0, np.inf]
        self._window = SECONDS  # [s] end of the present window

    def see(self, true: Truth) -> None:
        """Record one period."""
        self._steps += 1
        self._saturated += bool(true.saturated)
        self.away = float(np.linalg.norm(true.p_WB))

        # No point moves further than the hull does and its farthest point is turned.
        turned = float(np.arccos(np.clip(0.5 * (np.trace(true.R_WB) - 1.0), -1.0, 1.0)))
        sag = float(np.abs(true.q - self._q).sum())
        self._swing = max(self._swing, self.away + self._radius * (turned + sag))

        # Rest: slow and near enough, without a break.
        limits = self._limits
        rate = float(np.linalg.norm(true.w_WB_B))
        still = float(np.linalg.norm(true.v_WB_W)) <= limits.speed and rate <= limits.turn
        near = self.away <= limits.error
        self._quiet = self._quiet + self._period if still and near else 0.0
        self._rest = max(self._rest, self._quiet)

        self._rates[0] = max(self._rates[0], rate)
        # Figures of the end only, when the start has died out.
        if true.time > _LATE * SECONDS:
            tilt = float(np.arccos(np.clip(true.R_WB[2, 2], -1.0, 1.0)))
            self._turn = max(self._turn, rate)
            self._drift = max(self._drift, self.away)
            self._tilt = max(self._tilt, tilt)

    def ends(self, time: float) -> bool:
        """True after SECONDS once the hull has rested, or no longer calms down."""
        if self._rest >= self._limits.time:
            return True
        if time < self._window:
            return False
        calms = self._rates[0] < _SLOWER * self._rates[1]
        self._rates = [0.0, self._rates[0]]
        self._window = time + _WINDOW
        return not calms

    def figures(self) -> HoverFigures:
        """Figures of the complete simulation."""
        return HoverFigures(
            drift=self._drift,
            tilt=self._tilt,
            saturated=self._saturated / self._steps,
            rest=self._rest,
            turn=self._turn,
            power=_mean_power(self._plant, self._steps * self._period),
            swing=self._swing,
        )

    def broken_off(self, reason: str, drift: float) -> HoverFigures:
        """Figures of a simulation that stopped early."""
        share = self._saturated / max(self._steps, 1)
        return HoverFigures(drift=drift, tilt=np.pi, saturated=share, swing=np.inf, said=reason)


def _radius(plant: Plant) -> float:
    """Distance [m] of the vehicle's farthest point from its hull's origin, the arm at home."""
    model, data, vehicle = plant.model, mujoco.MjData(plant.model), plant.vehicle
    data.qpos[vehicle.qpos] = vehicle.q_home
    mujoco.mj_kinematics(model, data)
    away = np.linalg.norm(data.geom_xpos - data.xpos[vehicle.hull], axis=1) + model.geom_rbound
    return float(away.max(initial=0.0))


def _mean_power(plant: Plant, seconds: float) -> float | None:
    """Mean electrical power [W] of the thrusters over the check; None if it was not measured."""
    joules = float(plant.supply.state[ENERGY])
    return None if np.isnan(joules) else joules / seconds


def rigid(spec: mujoco.MjSpec, model: mujoco.MjModel) -> mujoco.MjModel:
    """Compiled model of a vehicle without a serial arm, with all joints held at home.

    Args:
        spec: Spec of the vehicle.
        model: The compiled spec, whose keyframe `home` states the posture.
    """
    held = spec.copy()
    key = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, HOME_KEY)
    qpos = model.qpos0 if key < 0 else model.key_qpos[key]
    home = {model.joint(j).name: float(qpos[model.jnt_qposadr[j]]) for j in range(model.njnt)}
    for part in [*held.equalities, *held.keys]:
        held.delete(part)
    hold(held, [joint for joint in held.joints if joint.type in TURNING], "for the check", home)

    # The result is a hull without an arm, if there was one.
    for site in [site for site in held.sites if site.name == TIP_SITE]:
        held.delete(site)
    for body in [body for body in held.bodies if body.name == ARM_BASE_BODY]:
        body.name = f"{ARM_BASE_BODY}_held"
    return hydrodynamics.compile(held)
