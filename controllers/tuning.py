"""Gains, filters and limits of all controllers, with default, unit and meaning.

    WorkController(model, tuning=ArmTuning(joint_frequency=40.0))

Each value is a `tuned` field of a frozen dataclass, with its unit and meaning; `table` lists them
for a report.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Self

import numpy as np

from uuv.controllers.ik.method import Method
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


def tuned(default: Any, about: str) -> Any:
    """Field of a tuning, with its default, its unit in brackets, and its meaning."""
    return field(default=default, metadata={"about": about})


def table(*tunings: Any) -> Iterator[tuple[str, str, str, str]]:
    """Rows for a report: tuning, name, value, unit and meaning.

    Args:
        tunings: Instances of the dataclasses of this module, or of controllers that inherit from
            them.
    """
    for tuning in tunings:
        for entry in fields(tuning):
            about = entry.metadata.get("about")
            setting = getattr(tuning, entry.name)
            if about:
                yield tuning.title, entry.name, str(setting), about
            elif is_dataclass(setting):
                yield from table(setting)


def check(
    tuning: Any, title: str, *, positive: Sequence[str], not_negative: Sequence[str] = ()
) -> None:
    """Check that fields of a tuning are finite, and > 0 or >= 0. A field may hold several numbers.

    Args:
        tuning: The tuning.
        title: Its name in an error.
        positive: Names of the fields that must be > 0.
        not_negative: Names of the fields that must be >= 0.

    Raises:
        ConfigurationError: A value is out of range.
    """
    for names, sign in ((positive, ">"), (not_negative, ">=")):
        for name in names:
            numbers = np.asarray(getattr(tuning, name), dtype=np.float64)
            if not (
                np.all(np.isfinite(numbers))
                and np.all(numbers > 0.0 if sign == ">" else numbers >= 0.0)
            ):
                raise ConfigurationError(
                    f"{title} {name}: must be {sign} 0, got {getattr(tuning, name)}"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class GearTuning:
    """Compensation of friction: in the gears, and of the tool on the surface."""

    title = "friction"

    filter: float = tuned(
        0.003,
        "[s] filter of the estimated gear friction; if slower, the force is too large after each "
        "reversal",
    )
    reversal: float = tuned(
        0.01, "[rad/s] desired speed over which the friction feedforward changes its sign"
    )
    known: float = tuned(0.8, "[-] share of the dry friction that is known while a joint slides")
    excess: float = tuned(
        1.5, "[-] largest ratio of the compensated friction to the modelled stiction"
    )
    feedforward: float = tuned(
        0.8, "[-] share of the tangential tool force that the servo feeds forward"
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class TorqueNoise:
    """Standard deviations that the force estimate assumes of joint torques."""

    title = "torques"

    share: float = tuned(
        0.01, "[-] standard deviation of a torque sensor as a share of its reading"
    )
    floor: float = tuned(0.1, "[N m] least standard deviation of a torque sensor")
    drift: float = tuned(
        0.3, "[N m] standard deviation of the external torques' drift since the tare"
    )
    observer_floor: float = tuned(0.4, "[N m] least standard deviation of the load observer")


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmTuning:
    """Gains and filters of the arm: joint servo, force estimate, friction."""

    title = "arm"

    joint_frequency: float = tuned(60.0, "[rad/s] bandwidth of the joint servo")
    joint_damping: float = tuned(
        2.0,
        "[-] damping ratio; with a smaller one, gear friction makes the tip chatter on stiff "
        "surfaces",
    )
    joint_integral_time: float = tuned(
        0.2, "[s] time constant of the servo's integral, for friction at the tool and model errors"
    )
    integral_limit: float = tuned(0.01, "[rad s] limit of the integral, in both directions")
    joint_speed_limit: float = tuned(
        1.6, "[rad/s] speed limit of the fastest joint; reached only in a retreat"
    )
    spare_joint_speed: float = tuned(
        0.1, "[rad/s] of joints to spare on the way off singular postures and limits"
    )
    force_filter: float = tuned(0.012, "[s] first-order filter of the force estimate")
    observer_lag: float = tuned(
        0.012, "[s] lag of the load observer, which is also the observer's filter"
    )
    acceleration_filter: float = tuned(
        0.015, "[s] filter of the joint acceleration, computed from the encoders' speed"
    )
    normal_softness: float = tuned(
        0.7, "[-] share of the servo's stiffness that force control removes along the tool axis"
    )
    hardening_time: float = tuned(
        0.3,
        "[s] to restore the stiffness after force control; a step would throw the tool into the "
        "surface",
    )
    weighing_after: float = tuned(
        2.0,
        "[s] after the start, at which payload identification begins, when filters have settled",
    )
    hover_period: float = tuned(0.02, "[s] period of station keeping and allocation")
    task_period: float = tuned(0.004, "[s] period of inverse kinematics and force loop")
    compliance_period: float = tuned(0.2, "[s] update period of the servo's compliance at the tip")
    blend_time: float = tuned(
        0.2, "[s] of the critically damped transition from held joint angles to a tool pose"
    )
    inverse_kinematics: Method = field(
        default="hybrid",
        metadata={
            "about": (
                "[-] method that tracks the tool pose; hybrid becomes priority unless the arm has "
                "six joints"
            )
        },
    )

    gears: GearTuning = field(default_factory=GearTuning)
    torques: TorqueNoise = field(default_factory=TorqueNoise)

    @property
    def servo_gains(self) -> Array:
        """(4,) of the servo: stiffness [1/s^2], damping [1/s], integral [1/s^3]; limit [rad s]."""
        w = self.joint_frequency
        return np.array(
            [
                w**2,
                2.0 * self.joint_damping * w,
                w**2 / self.joint_integral_time,
                self.integral_limit,
            ]
        )

    @property
    def motion_filters(self) -> tuple[float, float]:
        """Time constants [s] of the filters of the joint acceleration and of the estimated
        force.
        """
        return self.acceleration_filter, self.force_filter


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceLoopTuning:
    """Force loop: integral law, with optional P and D, from force error to displacement."""

    title = "force loop"
    bandwidth: float = tuned(24.0, "[rad/s] bandwidth of the closed loop on any surface")
    proportional_time: float = tuned(0.0, "[s] proportional gain over integral gain")
    derivative_time: float = tuned(0.0, "[s] derivative gain over proportional gain")
    response: float = tuned(
        0.08, "[s] lag from set to measured force that does not count as an error"
    )
    limit: float = tuned(0.04, "[m] largest displacement in either direction")
    speed: float = tuned(0.03, "[m/s] largest speed of the displacement")
    softest: float = tuned(2e-4, "[m/N] largest surface compliance, that of 5e3 N/m")
    smoothing: float = tuned(0.05, "[s] filter of force and displacement before the slope")
    memory: float = tuned(
        3.0, "[s] memory of the slope, which runs only while the set force changes"
    )
    prior: float = tuned(4.0, "[N] spread of the force at which the slope has half its weight")

    def __post_init__(self) -> None:
        positive = ("bandwidth", "limit", "speed", "softest", "smoothing", "memory", "prior")
        not_negative = ("proportional_time", "derivative_time", "response")
        check(self, "displacement", positive=positive, not_negative=not_negative)


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedForceTuning:
    """Published force law: PID from each component of the force error to a displacement."""

    title = "published force law"
    proportional: float = tuned(1e-5, "[m/N]")
    integral: float = tuned(5e-4, "[m/(N s)]")
    derivative: float = tuned(0.0, "[m s/N]")
    limit: float = tuned(
        0.04, "[m] largest displacement along the tool axis, and perpendicular to it"
    )
    speed: float = tuned(0.03, "[m/s] largest speed of the displacement")

    def __post_init__(self) -> None:
        check(
            self,
            "published force law",
            positive=("limit", "speed"),
            not_negative=("proportional", "integral", "derivative"),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ComplianceTuning:
    """Lateral compliance: admittance from the lateral contact force to the tool's position."""

    title = "lateral compliance"
    admittance: float = tuned(4e-4, "[m/(N s)] speed of the offset per lateral force")
    dead_band: float = tuned(1.5, "[N] dead band of the force")
    limit: float = tuned(0.012, "[m] largest offset")
    speed: float = tuned(0.02, "[m/s] largest speed of the offset")
    release_speed: float = tuned(0.01, "[m/s] at which the offset returns to zero")
    gentle_speed: float = tuned(
        0.005, "[m/s] largest speed of a tool at rest on a surface, in both directions"
    )

    def __post_init__(self) -> None:
        positive = ("admittance", "limit", "speed", "release_speed", "gentle_speed")
        check(self, "compliance", positive=positive, not_negative=("dead_band",))


@dataclass(frozen=True, slots=True, kw_only=True)
class HullTuning:
    """Station keeping, and use of the thrusters."""

    title = "hull"
    frequency: float = tuned(1.6, "[rad/s] natural frequency of the closed loop")
    damping: float = tuned(1.0, "[-] damping ratio of the closed loop")
    length: float = tuned(
        0.69,
        "[m] cube root of the displaced volume, below which the loop is faster by Froude's law",
    )
    mass: float = tuned(
        350.0,
        "[kg] mass of the vehicle for which thresholds of force and moment are set; they are "
        "proportional to it",
    )
    response: float = tuned(
        0.05,
        "[s] lag of the thrust with lead compensation; command noise grows by about lag / response",
    )
    headroom: float = tuned(
        0.98,
        "[-] share of full thrust that is used; the rest covers inflow and errors of the "
        "thrust curve",
    )
    gap_weights: tuple[float, ...] = tuned(
        (1.0, 1.0, 1.0, 4.0, 4.0, 0.5),
        "[1/N, 1/(N m)] weights of the wrench error due to minimal thrusts",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverDeviations:
    """Standard deviations assumed by the disturbance observer."""

    title = "disturbance observer"

    velocity_noise: float = tuned(
        0.008, "[m/s] per step, including the smoothing error of the navigation filter"
    )
    current: float = tuned(0.3, "[m/s] initial")
    current_walk: float = tuned(0.03, "[m/s/sqrt(s)] random walk: gusts of 5 cm/s within 5 s")
    gain: float = tuned(0.1, "[-] share of the thrust, initial")
    gain_walk: float = tuned(0.003, "[1/sqrt(s)] random walk")
    offset: float = tuned(0.01, "[m/s^2] steady force over the hull's inertia, initial")
    offset_walk: float = tuned(0.003, "[m/s^2/sqrt(s)] random walk")
    moment_bandwidth: float = tuned(
        3.0, "[rad/s] bandwidth of the Luenberger observer of the moment"
    )


# least share of `HullTuning.mass` by which thresholds of force are scaled, since sensor noise does
# not shrink
LIGHTEST = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultLimits:
    """Thresholds of fault detection."""

    title = "fault detection"

    vision_age: float = tuned(1.0, "[s] largest age of the newest picture")
    warm_up: float = tuned(
        4.0,
        "[s] duration of the initial learning, without detection except for the age of pictures",
    )
    frozen_time: float = tuned(0.05, "[s] for which a torque sensor may be frozen")
    frozen_encoder_time: float = tuned(
        0.02, "[s] for which an encoder may be frozen, while its drive is still servoed on it"
    )
    frozen_factor: float = tuned(
        5.0, "[-] and at least this multiple of its longest frozen run while healthy"
    )
    torque_time: float = tuned(0.1, "[s] filter of the difference between sensor and motor")
    torque_share: float = tuned(0.08, "[-] torque bound: share of the reading")
    torque_floor: float = tuned(0.05, "[-] plus this share of the drive's torque limit")
    friction: float = tuned(
        2.5, "[-] plus this many times the gear's stiction, which acts in both directions"
    )
    torque_confirm: float = tuned(0.1, "[s] for which the torque bound must be exceeded")
    learning_time: float = tuned(
        20.0, "[s] time constant of the average with which a torque residual is compared"
    )
    encoder_time: float = tuned(1.0, "[s] window for angle against integrated speed")
    encoder_slip: float = tuned(4e-3, "[rad] largest difference of the two")
    hull_time: float = tuned(0.15, "[s] filter of the hull's momentum balance")
    hull_learning_time: float = tuned(
        6.0, "[s] time constant of the average that counts as current, not as a fault"
    )
    hull_force: float = tuned(20.0, "[N] hull bound: missing force, moments divided by `lever`")
    hull_share: float = tuned(
        0.12, "[-] plus this share of the demanded thrust, summed over all thrusters"
    )
    hull_change: float = tuned(
        0.1,
        "[-] plus this share of the thrust's change from its usual value, since gains are "
        "uncertain",
    )
    hull_speed: float = tuned(
        250.0, "[N s/m] plus this multiple of the hull's speed, since drag is uncertain"
    )
    lever: float = tuned(0.5, "[m] that converts moments to forces")
    thruster_loss: tuple[float, float] = tuned(
        (0.5, 1.3),
        "[-] range of the missing share of its thrust that counts as the loss of a thruster",
    )
    thruster_moment: float = tuned(
        0.3,
        "[-] ratio of moment to force of a thruster's column, at `lever`, below which a loss "
        "resembles a current",
    )
    thruster_leftover: float = tuned(
        0.4, "[-] share of the missing wrench that the loss of a thruster may leave unexplained"
    )
    thruster_confirm: float = tuned(0.35, "[s] for which a loss must persist")
    current_confirm: float = tuned(
        0.4,
        "[s] for which a loss must persist if it may be a current or a wave; then the thruster is "
        "probed",
    )
    probe_share: float = tuned(0.12, "[-] size of a probe's doublet, as a share of full thrust")
    probe_time: float = tuned(0.6, "[s] of a doublet: half of it ahead, half of it astern")
    probe_again: float = tuned(
        4.0, "[s] after which a thruster that passed a probe may be probed again"
    )

    @classmethod
    def of_mass(cls, mass: float) -> Self:
        """The limits of a vehicle of `mass` [kg]; forces grow with it, lengths with its cube root.

        The ratio to the usual mass is rounded to tenths, so that a payload does not change the
        limits.
        """
        usual, share = cls(), max(LIGHTEST, round(mass / HULL.mass, 1))
        return cls(
            hull_force=share * usual.hull_force,
            hull_speed=share * usual.hull_speed,
            lever=share ** (1.0 / 3.0) * usual.lever,
        )

    def __post_init__(self) -> None:
        check(self, "health", positive=tuple(self.__slots__))


@dataclass(frozen=True, slots=True, kw_only=True)
class SafetyTuning:
    """Safety wrapper: rejection of estimates, braking of the arm, and blind departure of the
    hull.
    """

    title = "safety wrapper"

    old_imu: float = tuned(
        0.1, "[s] age of the newest IMU data, from which on an estimate is rejected"
    )
    braking_speed: float = tuned(
        0.4, "[rad/s] joint speed, from which on the full braking torque acts"
    )
    braking_share: float = tuned(0.5, "[-] braking torque as a share of the drive's torque limit")
    gentle_force: float = tuned(
        50.0, "[N] force at the tip, above which the arm yields once the work is aborted"
    )
    balance_time: float = tuned(
        1.0, "[s] over which thrusts and contact are averaged for a blind departure"
    )
    leave_acceleration: float = tuned(
        0.2, "[m/s^2] force of a blind departure, per mass of the vehicle"
    )
    leave_time: float = tuned(3.0, "[s] duration of this force away from the surface")
    rise_time: float = tuned(10.0, "[s] duration of the force upwards after that")


# The twist of a gear hides the link's inertia from the motor at high frequency. With the full gains
# the servo oscillates on gears of up to 1e6 N m/rad, with these gains it is stable down to 1e4 N
# m/rad.
ELASTIC_GEARS = ArmTuning(joint_frequency=30.0, joint_damping=1.0)

# The servo is softer than for work on a stiff surface; filters, noise and friction are the same
# (same sensors and gears).
_DRIVES = ArmTuning(joint_frequency=40.0, joint_damping=1.0, joint_integral_time=0.3)


@dataclass(frozen=True, slots=True, kw_only=True)
class TouchTuning:
    """Motion, stiffness and force of touches for calibration."""

    title = "touching"

    lift: float = tuned(0.05, "[m] height above the nest between touches")
    descent: float = tuned(0.03, "[m/s] speed of the spring's end; upwards twice as fast")
    beyond: float = tuned(
        0.012, "[m] by which the spring's end moves below the nest before it follows the tip"
    )
    move_speed: float = tuned(0.8, "[rad/s] speed limit of the fastest joint")
    settle: float = tuned(1.5, "[s] duration of pressing before the reading")
    reading: float = tuned(0.5, "[s] duration over which encoders are averaged")
    believable: float = tuned(0.03, "[m] a tip farther than this from the nest has missed it")
    stiffness: float = tuned(600.0, "[N/m] stiffness of the spring at the tip")
    most: float = tuned(12.0, "[N] largest force of the spring")
    push: float = tuned(10.0, "[N] constant force into the nest")
    let_go: float = tuned(
        0.3, "[s] time constant with which the spring's end approaches the tip, and the push grows"
    )
    turn_stiffness: float = tuned(
        60.0, "[N m/rad] stiffness of the spring that holds the pin's direction"
    )
    turn_most: float = tuned(8.0, "[N m] largest moment of that spring")
    damping: float = tuned(1.0, "joint damping as a multiple of the gears' viscous friction")
    drives: ArmTuning = _DRIVES  # servo for free motion, and filters of the force estimate


DRIVE_PERIOD = 0.002  # [s] period of joint servo and contact estimator
# default instances, for signatures
HULL, SAFETY, TOUCH = HullTuning(), SafetyTuning(), TouchTuning()
