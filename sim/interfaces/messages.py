"""Time-stamped, frozen messages: the only data exchanged between sensors, perception, control and
plant.

Every array is read-only. Frames: W world (z up), B hull, C camera (OpenCV axes), G tool (z out of
the tool), T target (the frame of its model). Ground truth is not a message: it never leaves `sim`.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, Self

import numpy as np

from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import GRAVITY, Array, readonly

_UNKNOWN = readonly([math.nan] * 3)  # [m]
_STILL = readonly([0.0] * 3)  # [rad/s]
_NONE = readonly([[0.0] * 6] * 6)  # [m^2]
_LINE = 2  # points of a path that has a direction
_UNBOUNDED = readonly([math.inf] * 3)  # [N]


class WorkState(StrEnum):
    """State of the task; the supervisor passes through these in order, or goes to RETREAT and
    ABORT.
    """

    SETTLE = "settle"  # station keeping until the hull is at rest
    SCAN = "scan"  # a depth frame is requested, and the identification runs
    CLOSE_IN = "close-in"  # the hull moves to the work pose, the arm to the pose before contact
    TARE = "tare"  # torque bias is estimated and removed, free of contact
    APPROACH = "approach"  # guarded move along the tool axis until contact
    PRESS = "press"  # force grows to the first set force; no motion along the path yet
    WORK = "work"  # motion along the path under force control, or the stay of a sampler in the hole
    SEARCH = "search"  # spiral search for the hole with a sampler in contact
    INSERT = "insert"  # insertion of a sampler, compliant to side forces
    WITHDRAW = "withdraw"  # the sampler is pulled out
    RETREAT = "retreat"  # tool leaves the surface along its axis
    DONE = "done"  # path finished and tool withdrawn
    ABORT = "abort"  # tool withdrawn before the path was finished


# States in which the tool works, in which a force may be set, and in which it may touch.
WORKING = (WorkState.WORK, WorkState.INSERT, WorkState.WITHDRAW)
TOUCHING = (WorkState.APPROACH, WorkState.PRESS, WorkState.SEARCH, *WORKING)
CONTACT = (*TOUCHING, WorkState.RETREAT)


class AbortCode(StrEnum):
    """Cause of an abort; `Reference.note` states it in a sentence, with figures."""

    NO_FRAME = "no frame"  # no depth frame or ping arrived
    NOT_IDENTIFIED = "not identified"  # neither the object nor a place on the seabed was accepted
    NO_GROUND = "no ground"  # the ground under the hull does not allow the descent
    # the probability of keeping the path's tolerance is too small
    PLACE_UNCERTAIN = "place uncertain"
    # finds of the object, some seconds apart, do not agree on one pose
    OBJECT_MOVES = "object moves"
    OUT_OF_REACH = "out of reach"  # the tool reaches its path from no hull pose
    # the thrusters cannot hold the hull in the current while the tool works
    CURRENT = "current too strong"
    NO_CLEAR_WAY = "no clear way"  # hull or arm would come too near to the object or the seabed
    HULL_NOT_AT_REST = "hull not at rest"  # the hull did not come to rest in time
    HULL_LATE = "hull late"  # the hull lags behind its commanded motion
    HULL_ADRIFT = (
        # the hull is farther from its reference than the limit `lost_place` in
        # `uuv.controllers.tasks`
        "hull adrift"
    )
    NO_CONTACT = "no contact"  # there is no surface where one is expected
    OBSTACLE = "obstacle"  # contact where none is expected
    GIVES_WAY = "surface gives way"  # the surface yields farther than any work allows for
    FORCE_NOT_REACHED = "force not reached"  # the estimated force stays below the first set force
    FORCE_NOT_HELD = "force not held"  # the estimated force stays above the set force
    FORCE_LIMIT = "force limit"  # the estimated force is above its limit
    # the estimated force is too uncertain in this posture of the arm
    FORCE_NOT_FELT = "force not felt"
    CONTACT_LOST = "contact lost"  # the estimated force falls to zero at work
    HOLE_NOT_FOUND = "hole not found"  # the spiral search did not find the hole
    JAMMED = "jammed"  # the sampler got stuck on the way in
    STUCK = "stuck"  # the sampler got stuck on the way out
    TUBE_FULL = "tube full"  # the sampler can take no more material
    JAWS = "jaws stuck"  # they neither reach an opening nor press, or their drive is silent
    NOT_GRIPPED = "not gripped"  # the jaws closed on nothing
    TOO_HEAVY = "too heavy"  # the object that was lifted
    DROPPED = "dropped"  # the object has slipped out of the jaws
    VALVE_STUCK = "valve stuck"  # the handle does not turn at the set moment
    TIME_LIMIT = "time limit"  # a phase took too long
    VISION = "vision lost"  # no position from vision for longer than the work may wait
    # two or more torque sensors; with one wrong sensor the work goes on
    TORQUE_SENSORS = "torque sensors wrong"
    ENCODER = "encoder wrong"  # encoder of one joint
    ATTITUDE = "attitude wrong"  # attitude reference
    THRUSTER = "thruster lost"  # a thruster gives less thrust than commanded
    ESTIMATE = "estimate lost"  # the estimate is not finite, or too old
    CONTROLLER = "controller failed"  # the controller's commands are not finite


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
    """Standard deviations of an inertial unit's errors, from its data sheet."""

    acceleration: float  # [m/s^2] white, per sample
    acceleration_bias: float  # [m/s^2] constant over a run
    rate: float  # [rad/s] white, per sample
    rate_bias: float  # [rad/s] constant over a run
    attitude: float  # [rad] white, per sample
    attitude_bias: float  # [rad] constant over a run


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuMeasurement:
    """Reading of the inertial unit and attitude reference at the hull origin."""

    time: float  # [s]
    specific_force_B: Array  # (3,) [m/s^2], acceleration minus gravity
    w_WB_B: Array  # (3,) [rad/s]
    R_WB: Array  # (3, 3)
    noise: ImuNoise | None = None  # from the data sheet; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True)
class DvlNoise:
    """Standard deviations of a Doppler velocity log's errors per axis, from its data sheet."""

    white: float  # [m/s] per sample
    bias: float = 0.0  # [m/s] constant over a run


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DvlMeasurement:
    """Velocity over ground from a Doppler velocity log (DVL)."""

    time: float  # [s]
    v_WB_B: Array  # (3,) [m/s]
    noise: DvlNoise | None = None  # from the data sheet; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DvlRangesMeasurement:
    """Ranges to the ground along the beams of a Doppler velocity log."""

    time: float  # [s]
    ranges: Array  # (k,) [m], NaN without an echo
    axes_B: Array  # (k, 3) unit axes of the beams
    p_BD: Array  # (3,) [m] position of the transducer array in the hull


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PressureMeasurement:
    """Reading of the pressure gauge."""

    time: float  # [s]
    pressure: float  # [Pa] absolute
    depth: float  # [m] of the gauge below the surface, computed by the gauge from the pressure


@dataclass(frozen=True, slots=True, kw_only=True)
class VisionNoise:
    """Standard deviations per axis of the errors of a position from vision."""

    white: float  # [m] per image
    wander: float = 0.0  # [m] of a slow error (first-order Gauss-Markov)
    wander_time: float = 60.0  # [s] its correlation time


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VisionMeasurement:
    """Position of the hull relative to the scene, from vision. `time` is the time of exposure, not
    of arrival.
    """

    time: float  # [s]
    p_WB: Array  # (3,) [m]
    noise: VisionNoise | None = None  # from the data sheet; None: not stated


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DepthImage:
    """One frame of a depth camera, with the camera's pose in the hull."""

    time: float  # [s]
    depth: Array  # (height, width) [m] along the optical axis, NaN without a measurement
    K: Array  # (3, 3) [px] pinhole matrix
    X_BC: Array  # (4, 4) camera in hull


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SonarScan:
    """One ping of a 3D sonar, with its pose in the hull."""

    time: float  # [s]
    points: Array  # (H, W, 3) [m] in the sensor frame S, one for each beam, NaN without an echo
    X_BS: Array  # (4, 4) sensor in hull; OpenCV axes: x right, y down, z ahead


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceMotionMeasurement:
    """Motion of a camera on the arm's last link relative to the object in view, since a key image.

    A key image that was not itself measured against an earlier one begins a new track, since the
    motion before it is unknown. A key image whose time is that of the preceding message continues
    the track.
    """

    time: float  # [s] of exposure
    key_time: float  # [s] of exposure of the key image K
    p_KC: Array  # (3,) [m] position of the camera in key axes
    R_KC: Array  # (3, 3) rotation of the camera, from attitude reference and encoders
    # (3, 3) [1/m^2] inverse covariance of `p_KC`; zero in directions that were not observed
    information_K: Array
    q: Array  # (n,) [rad] joint angles at exposure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolAtRest:
    """The pressed tool has been at rest on the object since a given time, held by friction. This is
    sent by the planner, not by a sensor.

    Two messages with the same `since` mean that the tool has not moved over the surface between
    them.
    """

    time: float  # [s]
    since: float  # [s] when it came to rest
    q: Array  # (n,) [rad] joint angles
    slip_sigma: float  # [m] standard deviation of its motion over the surface since


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyedPose:
    """Pose of the object as known from a survey of the site."""

    time: float  # [s]
    X_WT: Array  # (4, 4)


@dataclass(frozen=True, slots=True, kw_only=True)
class JawMeasurement:
    """Reading of a gripper's drive: opening of the jaws, and force of the motor."""

    time: float  # [s]
    opening: float  # [m] between the pads
    speed: float  # [m/s] of the opening, positive: it grows
    force: float  # [N] of the motor on each finger, from its current, positive: it closes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeldLoad:
    """A body that the jaws hold, as the vehicle knows it. It may be lighter than water."""

    mass: float  # [kg]
    displaced: float  # [kg] of water that it displaces
    center_G: Array  # (3,) [m] centre of mass, tool axes, from the tip
    buoyancy_G: Array  # (3,) [m] centre of buoyancy, likewise
    radius: float = 0.0  # [m] of gyration; 0: a point

    @property
    def weight(self) -> float:
        """Weight [N] in water; negative if it floats."""
        return GRAVITY * (self.mass - self.displaced)

    def part(self, share: float) -> "HeldLoad":
        """The load with a share [-] of its mass and volume."""
        return replace(self, mass=share * self.mass, displaced=share * self.displaced)


@dataclass(frozen=True, slots=True, kw_only=True)
class JawSetpoint:
    """Set point of a gripper's drive: an opening, to be reached with bounded speed and force.

    Jaws that meet something before press it with the force.
    """

    opening: float  # [m] between the pads
    speed: float  # [m/s] of the opening, at most
    force: float  # [N] of the motor on each finger, at most
    # what they hold, which the controller counts as a part of the arm; None: nothing, or unknown
    holds: HeldLoad | None = None
    # what they hold is to be identified now, from what is expected; None: it is not
    weigh: HeldLoad | None = None


Look = DepthImage | SonarScan | SurveyedPose  # input of target identification

Measurement = (
    EncoderMeasurement
    | TorqueMeasurement
    | ImuMeasurement
    | DvlMeasurement
    | DvlRangesMeasurement
    | PressureMeasurement
    | VisionMeasurement
    | SurfaceMotionMeasurement
    | ToolAtRest
    | JawMeasurement
    | Look
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundPlane:
    """Plane fitted to the seabed under the vehicle."""

    time: float  # [s] of the newest ranges used
    p_W: Array  # (3,) [m] a point of the plane; NaN with too few beams
    normal_W: Array  # (3,) unit normal, upwards; NaN with too few beams
    scatter: float  # [m] RMS distance of the beams' ground points from the plane; 0 for three beams
    beams: int  # number of beams with an echo
    silent: tuple[int, ...]  # beams without an echo, counted from 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StateEstimate:
    """State of the vehicle as estimated on board."""

    time: float  # [s]
    X_WB: Array  # (4, 4) hull pose
    v_WB_B: Array  # (3,) [m/s]
    w_WB_B: Array  # (3,) [rad/s]
    a_WB_B: Array  # (3,) [m/s^2] acceleration of the hull origin, gravity removed
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m] measured at the gear outputs
    # (n,) [N m] standard deviation in addition to the sensors' noise; None if there is none
    tau_doubt: Array | None = None
    # (3,) [m] standard deviation of the hull position, W; NaN if unknown
    position_sigma: Array = field(default_factory=lambda: _UNKNOWN)
    # [rad] standard deviation of the hull's attitude about any axis; NaN if unknown
    attitude_sigma: float = math.nan
    # [s] since exposure of the newest image that was used; NaN if unknown
    vision_age: float = math.nan
    dvl_age: float = math.nan  # [s] the same for the DVL; inf if it was never used
    imu_age: float = math.nan  # [s] the same for the IMU
    # [s] since a jump of the accelerometer's bias was detected; inf: never, NaN: unknown
    imu_jump_age: float = math.nan
    # (3,) [m] significant displacement of the object that the arm's camera tracks; else zero
    object_moved_W: Array = field(default_factory=lambda: _STILL)
    # (3,) [rad/s] detected error of the gyro; zero about the other axes
    gyro_off_B: Array = field(default_factory=lambda: _STILL)
    # (3,) [rad] the same for the attitude reference. About an axis with a gyro error, either of the
    # two may be wrong; the values are no rotation then if NaN
    attitude_off_B: Array = field(default_factory=lambda: _STILL)
    ground: GroundPlane | None = None  # ground plane under the hull; None if unknown
    jaws: JawMeasurement | None = None  # newest reading of a gripper; None before the first


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolPath:
    """Tool path on the real surface, sampled densely over its arc length."""

    # (N,) [m] arc length from 0, increasing. A turn of the tool at rest adds 2 cm for 1 rad
    s: Array
    p: Array  # (N, 3) [m] points of the tool tip
    z: Array  # (N, 3) unit tool axis, into the surface
    x: Array  # (N, 3) unit axis across the tool axis, along the path unless `keeps_x`
    # (N,) bool: the point is on the scanned surface (else taken from the model alone)
    on_scan: np.ndarray
    # (N,) bool: the tool can press there, at both ends too; None: at all points
    fits: np.ndarray | None = None
    pace: float = 1.0  # share of the set speed that the surface allows
    # the tool is not round and keeps its x axis on x; False: it may turn about z
    keeps_x: bool = False
    note: str = ""  # parts of the path that are left out, and why


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """Identified target, a known object or a place on the seabed: its pose and tool path in W.

    `covariance` includes the errors of the registration and of the estimated hull pose. Finds
    within some seconds share the error of the hull pose, which therefore does not shrink in their
    mean.
    """

    time: float  # [s] of the frame that it was found in
    X_WT: Array  # (4, 4) pose of the model frame; level for a place on the seabed
    accepted: bool  # passed the pose check
    check_m: float  # [m] error measure of the pose check; inf if it could not be computed
    range_m: float  # [m] camera to the target's centre
    reason: str  # reason why it was not accepted; empty if it was
    path: ToolPath | None  # in W; None if not accepted
    ground: Array | None = None  # (V, 3) [m] points of the seabed around it, W; None: not measured
    # of X_WT in W, about the object's centre; None: not known
    covariance: PoseCovariance | None = None
    # (6, 6) [m^2] part of this covariance that comes from the hull pose
    hull_covariance: Array = field(default_factory=lambda: _NONE)
    # (4, 4) hull pose of the most informative next look; None: no other look is wanted
    next_X_WB: Array | None = None

    @property
    def path_sigma(self) -> Array | None:
        """Standard deviations (N, 3) [m] of the surface under the path; None without a path or a
        covariance.

        The columns are along the surface's normal, along the path and across it. A turn about the
        object's axis of symmetry does not count. The value is inf where another free twist moves
        the surface in that direction.
        """
        if self.path is None or self.covariance is None or len(self.path.p) < _LINE:
            return None
        p, z = self.path.p, self.path.z
        along = np.gradient(p, axis=0)
        along -= np.sum(along * z, axis=1, keepdims=True) * z
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
        directions = (z, along, np.cross(z, along))
        return np.stack(
            [self.covariance.surface_sigma(p, direction) for direction in directions], axis=1
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What the vehicle expects of its work before it touches the object."""

    chance: (
        float  # probability that the tool stays within the tolerance of its path on the true object
    )
    tolerance: float  # [m] along the path and across it
    navigation_sigma: float  # [m] standard deviation per axis of the estimated hull position
    object_sigma: float  # [m] of the found surface, along or across the path, whichever is larger

    def __str__(self) -> str:
        """The promise in words, with figures."""
        return (
            f"path error < {1e3 * self.tolerance:.3g} mm: probability {self.chance:.1%} "
            f"(sigma: hull {1e3 * self.navigation_sigma:.1f} mm, object "
            f"{1e3 * self.object_sigma:.1f} mm)"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ObjectMotion:
    """Pose of a followed object, and its motion since it was first followed."""

    time: float  # [s] of the frame
    X_WT: Array  # (4, 4) pose of the model frame
    # (6,) motion since the start: of the centre [m], and rotation vector x radius [m]; 0 along free
    # twists
    twist_W: Array
    covariance_W: Array  # (6, 6) [m^2] of `twist_W`
    radius: float  # [m] of the object
    moved: bool  # motion is significant in two consecutive frames

    @property
    def distance(self) -> float:
        """Distance [m] that the centre has moved."""
        return float(np.linalg.norm(self.twist_W[:3]))

    @property
    def distance_sigma(self) -> float:
        """Standard deviation [m] of the motion of the centre, along it."""
        way = self.twist_W[:3] / max(self.distance, 1e-12)
        return float(np.sqrt(max(0.0, way @ self.covariance_W[:3, :3] @ way)))

    @property
    def turn(self) -> float:
        """Angle [rad] by which the object has turned, without free rotations."""
        return float(np.linalg.norm(self.twist_W[3:])) / self.radius


class FaultKind(StrEnum):
    """Kind of fault that the vehicle can detect on board."""

    ESTIMATE = "estimate"  # NaN, or time does not advance: no control is possible
    CONTROLLER = "controller"  # commands are NaN
    VISION = "vision"  # too old to follow a path by
    TORQUE_SENSOR = "torque sensor"  # of one joint
    ENCODER = "encoder"  # of one joint
    THRUSTER = "thruster"  # a thruster gives another thrust than commanded
    IMU = "IMU"  # the accelerometer's bias jumped, and is estimated again
    GYRO = "gyro"  # gyro error about one axis of the hull; the rate comes from the attitude instead
    # error of the attitude reference; the attitude comes from the gyro instead
    ATTITUDE = "attitude"


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One detected fault."""

    kind: FaultKind
    part: str  # name of the joint or thruster; empty if there is only one
    index: int  # index of the joint or thruster; -1 if there is only one
    time: float  # [s] of detection
    figures: str = ""  # evidence in words: "gave 3 N where 11 N were commanded"
    thrust: float = 0.0  # [N] thrust of a failed thruster at any command


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reference:
    """Set points of the planner for the controller."""

    time: float  # [s]
    state: WorkState
    X_WB: Array  # (4, 4) hull pose to hold
    v_WB_W: Array  # (3,) [m/s] velocity of that pose
    X_WG: Array | None  # (4, 4) tool pose to follow, or None: hold `q`
    v_WG_W: Array  # (3,) [m/s] velocity of the tool point
    w_WG_W: Array  # (3,) [rad/s] angular velocity of the tool frame
    # (n,) [rad] joint angles to hold when X_WG is None; otherwise the initial posture of IK
    q: Array
    qd: Array  # (n,) [rad/s] velocity of `q`
    set_force: float  # [N] normal force to press with; 0 when free of contact
    force_control: bool  # close the force loop
    tare: bool  # average the joint torques now, to remove their bias
    scan: bool  # take a depth frame now
    path_s: float  # [m] arc length reached on the tool path
    # cause of an abort, set from the time when the work is broken off
    abort: AbortCode | None = None
    note: str = ""  # this cause in a sentence, or another message
    touch: int | None = None  # index of the touch whose reading is taken now
    compliant: bool = False  # yield to forces across the tool axis
    standing: bool = False  # the pressed tool stands on the surface: yield gently
    lost_thrusters: tuple[int, ...] = ()  # thrusters that have failed and are not to be used
    # [N] thrust of each of these at any command; empty if there are none
    lost_thrust: tuple[float, ...] = ()
    # promise of the work, from the tare on; None: none yet, or there is no basis for one
    promise: Promise | None = None
    # (3,) [rad/s] angular velocity of the hull pose to hold
    w_WB_W: Array = field(default_factory=lambda: _STILL)
    # target that the work uses, the mean of several finds; None: none yet
    target: Target | None = None
    # for navigation; None: the tool moves, or nothing has changed
    at_rest: ToolAtRest | None = None

    @classmethod
    def holding(cls, time: float, X_WB: Array, q: Array, **others: Any) -> Self:
        """Set points that hold a hull pose (4, 4) and joint angles (n,) [rad], free of contact.

        Args:
            time: [s]
            X_WB: Hull pose.
            q: Joint angles.
            **others: Fields that differ, such as `qd` or `state`, which is SETTLE.
        """
        # Nothing is commanded about motion and contact.
        at_rest = {
            "state": WorkState.SETTLE,
            "v_WB_W": _STILL,
            "X_WG": None,
            "v_WG_W": _STILL,
            "w_WG_W": _STILL,
            "qd": np.zeros_like(q),
            "set_force": 0.0,
            "force_control": False,
            "tare": False,
            "scan": False,
            "path_s": 0.0,
        }

        return cls(time=time, X_WB=X_WB, q=q, **(at_rest | others))

    @property
    def in_contact(self) -> bool:
        """True while the tool is supposed to be in contact."""
        return self.set_force > 0.0 or self.force_control


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JawReference(Reference):
    """Set points of a vehicle with a gripper, whose drive continues with the last ones."""

    jaws: JawSetpoint


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HandleReading:
    """Handle of a valve as the vehicle feels it through the tool."""

    angle: float  # [rad] turned since the tool met it; NaN: it has not
    moment: float  # [N m] of the tool about the valve's axis


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnReference(Reference):
    """Set points while a handle is turned, and its estimated angle and moment."""

    handle: HandleReading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactEstimate:
    """Force of the world on the tip as estimated on board. The default is an unknown force."""

    force_W: Array = field(default_factory=lambda: _UNKNOWN)  # (3,) [N] in W; NaN: not known
    # [N] along the tool axis, positive when the tool presses; NaN: not known
    normal: float = math.nan
    # (3,) [N] standard deviation, tool axes
    sigma_G: Array = field(default_factory=lambda: _UNBOUNDED)
    load: HeldLoad | None = None  # what the jaws hold, while it is being identified
    # (n,) [N m] torque of the world on each joint, without tare and filter; None: not reported
    torques: Array | None = None

    @property
    def known(self) -> bool:
        """True if the normal force is a number."""
        return math.isfinite(self.normal)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HullLoad:
    """Loads on the hull that station keeping used in its last step. Each step makes a new
    object.
    """

    # (6,) [N, N m] of the arm on the hull, contact included, hull axes at the hull's origin
    arm_wrench_B: Array
    current_W: Array = field(default_factory=lambda: _STILL)  # (3,) [m/s] estimated current


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Command:
    """Output of the controller: drive commands, and its estimates of contact and loads."""

    time: float  # [s]
    joint_torque: Array  # (n,) [N m]
    thrusters: Array  # (m,) normalised propeller speed in [-1, 1]
    scan: bool  # take a depth frame now
    contact: ContactEstimate = field(default_factory=ContactEstimate)
    hull_load: HullLoad | None = None  # None: not reported
    # further arrays by name, for the log only
    believed: Mapping[str, Array] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()  # detected faults, in order of detection
