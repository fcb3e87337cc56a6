"""Time-stamped, frozen messages: the only things that travel between rooms.

Every array is read-only. Frames: W world (z up), B hull, C camera (OpenCV axes), G tool (z out of the tool),
T target (the frame of its model). Ground truth is not a message: it never leaves `sim`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from sim.interfaces.spatial import Array, readonly

_UNKNOWN = readonly([math.nan] * 3)
_STILL = readonly([0.0] * 3)


class WorkState(StrEnum):
    """What the vehicle is doing; the supervisor moves through these in order, or falls to RETREAT and ABORT."""

    SETTLE = "settle"  # hover until the hull is quiet
    SCAN = "scan"  # a depth frame is asked for, identification runs
    CLOSE_IN = "close-in"  # the hull moves to the work pose, the arm to the pose before contact
    TARE = "tare"  # torque bias is removed, free of contact
    APPROACH = "approach"  # guarded move along the tool axis until contact
    PRESS = "press"  # force grows to its first set value; no motion along the path yet
    WORK = "work"  # motion along the path under force control; of a sampler, its stay in the hole
    SEARCH = "search"  # a sampler feels for its hole in a spiral
    INSERT = "insert"  # a sampler goes into its hole, giving way to what pushes it aside
    WITHDRAW = "withdraw"  # a sampler is drawn out again
    RETREAT = "retreat"  # tool leaves the surface along its axis
    DONE = "done"  # path finished and tool withdrawn
    ABORT = "abort"  # tool withdrawn before the path was finished


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EncoderMeasurement:
    """Joint encoders."""

    time: float  # [s]
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TorqueMeasurement:
    """One-component torque sensors on the gear outputs."""

    time: float  # [s]
    tau: Array  # (n,) [N m], along the joint axis, on the child


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuNoise:
    """Standard deviations of an inertial unit's errors, as its maker states them."""

    acceleration: float  # [m/s^2] white, per sample
    acceleration_bias: float  # [m/s^2] constant over a run
    rate: float  # [rad/s] white, per sample
    rate_bias: float  # [rad/s] constant over a run
    attitude: float  # [rad] white, per sample
    attitude_bias: float  # [rad] constant over a run


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuMeasurement:
    """Inertial unit and attitude reference at the hull origin."""

    time: float  # [s]
    specific_force_B: Array  # (3,) [m/s^2], acceleration minus gravity
    w_WB_B: Array  # (3,) [rad/s]
    R_WB: Array  # (3, 3)
    noise: ImuNoise | None = None  # as stated by the maker; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True)
class DvlNoise:
    """Standard deviations of a Doppler log's errors per axis, as its maker states them."""

    white: float  # [m/s] per sample
    bias: float = 0.0  # [m/s] constant over a run


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DvlMeasurement:
    """Velocity over ground."""

    time: float  # [s]
    v_WB_B: Array  # (3,) [m/s]
    noise: DvlNoise | None = None  # as stated by the maker; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DvlRangesMeasurement:
    """Ranges to the ground along the beams of a Doppler log."""

    time: float  # [s]
    ranges: Array  # (k,) [m], NaN where no echo came
    axes_B: Array  # (k, 3) unit axes of the beams
    p_BD: Array  # (3,) [m] the array on the hull


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressureMeasurement:
    """Pressure gauge."""

    time: float  # [s]
    pressure: float  # [Pa] absolute
    depth: float  # [m] of the gauge below the surface, as it makes of the pressure


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionNoise:
    """Standard deviations of the errors of a position from vision per axis, as its maker states them."""

    white: float  # [m] per picture
    wander: float = 0.0  # [m] of a slow error (Gauss-Markov)
    wander_time: float = 60.0  # [s] over which it forgets itself


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisionMeasurement:
    """Position of the hull against the scene, from vision; `time` is when the picture was taken, not its arrival."""

    time: float  # [s]
    p_WB: Array  # (3,) [m]
    noise: VisionNoise | None = None  # as stated by the maker; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthImage:
    """One frame of a depth camera, with the camera's place on the hull."""

    time: float  # [s]
    depth: Array  # (height, width) [m] along the optical axis, NaN where nothing came back
    K: Array  # (3, 3) pinhole matrix [px]
    X_BC: Array  # (4, 4) camera in hull


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SonarScan:
    """One ping of a 3D sonar, with its place on the hull."""

    time: float  # [s]
    points: Array  # (H, W, 3) [m] in the sensor frame S, one for each beam, NaN where no echo came back
    X_BS: Array  # (4, 4) sensor in hull; OpenCV axes: x right, y down, z ahead


Look = DepthImage | SonarScan  # what a target is found in

Measurement = (
    EncoderMeasurement
    | TorqueMeasurement
    | ImuMeasurement
    | DvlMeasurement
    | DvlRangesMeasurement
    | PressureMeasurement
    | VisionMeasurement
    | DepthImage
    | SonarScan
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundPlane:
    """The seabed under the vehicle, on the whole."""

    time: float  # [s] of the last ranges in it
    p_W: Array  # (3,) [m] a point of the plane; NaN where too few beams make one
    normal_W: Array  # (3,) unit, upwards; NaN alike
    scatter: float  # [m] RMS distance of the beams' places from it; 0 of three
    beams: int  # that see the ground
    silent: tuple[int, ...]  # beams, from 1, that do not


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateEstimate:
    """What the vehicle believes of itself."""

    time: float  # [s]
    X_WB: Array  # (4, 4) hull pose
    v_WB_B: Array  # (3,) [m/s]
    w_WB_B: Array  # (3,) [rad/s]
    a_WB_B: Array  # (3,) [m/s^2] acceleration of the hull origin, gravity removed
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m] measured at the gear outputs
    tau_doubt: Array | None = None  # (n,) [N m] standard deviation of each beside the sensors' noise; None: of none
    position_sigma: Array = field(default_factory=lambda: _UNKNOWN)  # (3,) [m] of the hull's place, W; NaN: not said
    vision_age: float = math.nan  # [s] since the newest picture that was used was taken; NaN: not said
    dvl_age: float = math.nan  # [s] the same of the DVL; inf: none was ever used
    imu_age: float = math.nan  # [s] the same of the IMU
    ground: GroundPlane | None = None  # under the hull; None: not said


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolPath:
    """A tool path on the real surface, sampled densely over its arc length."""

    s: Array  # (N,) [m] arc length, from 0, increasing
    p: Array  # (N, 3) [m] points of the tool tip
    z: Array  # (N, 3) unit tool axis, into the surface
    x: Array  # (N, 3) unit axis across the tool axis, along the path
    on_scan: np.ndarray  # (N,) bool: lies on the scanned surface (else carried over from the model alone)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """A known object or a place on the seabed, found: its pose and the tool path on it, in W."""

    time: float  # [s] of the frame that it was found in
    X_WT: Array  # (4, 4) pose of the model frame; of a place on the seabed, level
    accepted: bool  # the check held
    check_m: float  # [m] the check's figure; inf if it could not be made
    range_m: float  # [m] camera to the target's centre
    reason: str  # why it was not accepted; empty if it was
    path: ToolPath | None  # in W; None if not accepted
    ground: Array | None = None  # (V, 3) [m] points of the seabed around it, W; None: not looked at


class FaultKind(StrEnum):
    """What the vehicle can find wrong with itself."""

    ESTIMATE = "estimate"  # not a number, or time stands still: nothing can be controlled
    CONTROLLER = "controller"  # its commands are not numbers
    VISION = "vision"  # too old to be followed along a path
    TORQUE_SENSOR = "torque sensor"  # of one joint
    ENCODER = "encoder"  # of one joint
    THRUSTER = "thruster"  # one gives less than it is asked for


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing found wrong."""

    kind: FaultKind
    part: str  # name of the joint or thruster; empty where there is but one
    index: int  # of it; -1 where there is but one
    time: float  # [s] it was found
    figures: str = ""  # by which it was found, in words: "gave 3 N where 11 N were asked for"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """What the controller is asked to do now."""

    time: float  # [s]
    state: WorkState
    X_WB: Array  # (4, 4) hull pose to hold
    v_WB_W: Array  # (3,) [m/s] velocity of that pose
    X_WG: Array | None  # (4, 4) tool pose to follow, or None: hold `q`
    v_WG_W: Array  # (3,) [m/s] velocity of the tool point
    w_WG_W: Array  # (3,) [rad/s] angular velocity of the tool frame
    q: Array  # (n,) [rad] joint angles to hold when X_WG is None; else the posture to start IK from
    qd: Array  # (n,) [rad/s] velocity of `q`
    force: float  # [N] set normal force; 0 when free of contact
    force_control: bool  # close the force loop
    tare: bool  # average the joint torques now, to remove their bias
    scan: bool  # take a depth frame now
    path_s: float  # [m] arc length reached on the tool path
    note: str = ""  # why the work was broken off, once it was
    compliant: bool = False  # give way to forces across the tool axis
    lost_thrusters: tuple[int, ...] = ()  # not to be counted on
    w_WB_W: Array = field(default_factory=lambda: _STILL)  # (3,) [rad/s] angular velocity of the hull pose to hold


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Command:
    """What goes to the drives, what the controller feels (for the planner), and what it believes (for logs)."""

    time: float  # [s]
    joint_torque: Array  # (n,) [N m]
    thrusters: Array  # (m,) normalised propeller speed in [-1, 1]
    scan: bool  # take a depth frame now
    felt_normal: float = float("nan")  # [N], normal force at the tool by its estimate; NaN: it has none
    believed: Mapping[str, Array] = field(default_factory=dict)  # named arrays for the log, e.g. "f_tip_W" (3,) [N]
    faults: tuple[Fault, ...] = ()  # what it finds wrong with the vehicle, first found first
