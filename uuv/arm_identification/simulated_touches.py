"""Simulated touches of an arm with errors, by hand or by contact, as input of a calibration."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.arm_identification.calibration_case import UNLOADED, CalibrationCase, Loading, TrueArm
from uuv.arm_identification.touching import touch
from uuv.calib.arm_files import ArmSource
from uuv.calib.simulation import EccentricGears, Sag, Seating, read_by_encoders, wrong_arm
from uuv.calib.touch_files import Touches
from uuv.components.deck_calibration import DOWN, LENGTH_ERROR, farthest, touched
from uuv.models.arms import dh_geometry
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, readonly
from uuv.sim.interfaces.streams import Streams
from uuv.sim.loop.rollout import Observer

# [m] tip in the flange
TOOLS = {"straight": (0.0, 0.0, 0.15), "off-axis": (0.06, 0.0, 0.15)}
# Tool direction in an arm's base whose z axis points up.
LOOKING_DOWN = (0.0, 0.0, -1.0)
# Errors of an arm from a workshop: theta, alpha, beta [rad], d, a [m].
WORKSHOP = {
    "theta": np.deg2rad(0.3),
    "d": 2e-3,
    "a": 2e-3,
    "alpha": np.deg2rad(0.3),
    "beta": np.deg2rad(0.3),
}
# Identified DH table of the UR10e in [Yukhimets 2023]: theta [deg], a [mm], d [mm], alpha [deg].
PAPER_UR10E = np.array(
    [
        [0.0, 0.0015, 180.7, 90.0193],
        [0.0047, -612.7056, -0.0002, -0.0682],
        [0.0015, -571.3064, -0.0002, -0.2073],
        [0.0017, -0.0756, 174.1, 89.9643],
        [0.0467, 0.1869, 120.2671, -90.0688],
        [-0.0253, 0.0356, 115.8641, -0.0102],
    ]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RealEffects:
    """Effects of real arms and sockets that a kinematic model lacks, for simulated touches."""

    compliance: float = 0.0  # [rad/(N m)] of every joint
    gears: float = 0.0  # [rad] spread of the amplitudes of eccentric gears
    seating: float = 0.0  # [m] spread of the seating errors of the ball along each axis


def simulated(
    source: ArmSource,
    *,
    points: int,
    touches: int,
    noise: float,
    pin: str,
    known: bool,
    errors: int,
    rng: np.random.Generator,
    real: RealEffects = RealEffects(),
    loading: Loading = UNLOADED,
) -> CalibrationCase:
    """Calibration case from simulated touches by hand of an arm with errors.

    The true arm of a UR10e is the one of [Yukhimets 2023]; other arms have workshop errors.

    Args:
        source: Nominal arm.
        points: Number of points.
        touches: Touches of each point.
        noise: [m] standard deviation of a touch along each axis.
        pin: Name in TOOLS.
        known: Whether the distance between the two farthest points is given.
        errors: Seed of the workshop errors.
        rng: Draws points, touches and the error of the distance.
        real: Effects in the true arm and its sockets.
        loading: Weights under which the joints bend.

    Raises:
        ReachError: Too few points are reached.
    """
    # The true arm and its tool point.
    drawing = np.random.default_rng(errors)
    if source.kind == "mjcf":
        arm = dh_geometry.with_errors(source.arm, drawing)
        # The tip site is the tip of the vehicle's own tool. An off-axis pin protrudes sideways from
        # the tool.
        tcp = np.array([TOOLS[pin][0], 0.0, 0.0])
        hangs = True
        title = f"Calibration of {source.path.stem}, built with workshop errors {errors}"
    else:
        tcp = np.array(TOOLS[pin])
        hangs = False
        if source.path.name == "ur10e":
            theta, a, d, alpha = PAPER_UR10E.T
            rows = np.column_stack([np.deg2rad(theta), d * 1e-3, a * 1e-3, np.deg2rad(alpha)])
            arm = replace(SerialArm.from_dh(rows), limits=source.arm.limits)
            title = "Calibration of a UR10e as in [Yukhimets 2023]"
        else:
            arm = wrong_arm(source.arm, WORKSHOP, drawing)
            title = f"Calibration of {source.path.name}, built with workshop errors {errors}"

    series, places = touched(
        arm,
        tcp,
        arm.limits,
        rng,
        points=points,
        touches=touches,
        noise=noise,
        way=DOWN if hangs else LOOKING_DOWN,
    )

    # Effects in addition to the kinematics, each with its own random stream.
    sag, gears, unloaded = None, None, None
    if real.compliance > 0.0:
        sag = Sag(compliance=np.full(arm.n, real.compliance), loads=loading.on(source, points))
        unloaded = replace(sag, loads=replace(sag.loads, payload_mass=0.0))
    if real.gears > 0.0:
        gears = EccentricGears.draw(real.gears, arm.n, Streams(errors)["gears"])
    if real.seating > 0.0:
        seats = Seating.draw(real.seating, points, Streams(errors)["seating"])
        series = seats.seat(arm, tcp, series)

    series = read_by_encoders(arm, series, sag=sag, gears=gears)
    truth = TrueArm(arm=arm, tcp=tcp, hangs=hangs, sag=unloaded, gears=gears)
    return _simulated_case(title, source, series, places, truth, known, rng)


def by_contact(
    source: ArmSource,
    scenario: Scenario,
    *,
    known: bool,
    rng: np.random.Generator,
    watch: Callable[[mujoco.MjModel], Observer] | None = None,
) -> CalibrationCase:
    """Calibration case from touches by contact: the vehicle's true arm presses a pin into nests.

    Args:
        source: Nominal arm.
        scenario: Scenario from `touching_scenario`.
        known: Whether the distance between the two farthest nests is given.
        rng: Draws the error of that distance.
        watch: Makes a further observer of the loop for the compiled world.

    Raises:
        ConfigurationError: The vehicle lacks a part, or fewer than two nests were found.
        ReachError: The arm does not reach enough nests.
    """
    vehicle = scenario.vehicle
    session, believed = touch(scenario, watch)

    # The true arm that `touch` built.
    nominal_arm = dh_geometry.read(
        believed.model, ARM_BASE_BODY, TIP_SITE, exclude=believed.passive_joints
    )
    true = dh_geometry.with_errors(nominal_arm, np.random.default_rng(vehicle.arm_errors))
    hull = "hovering" if session.hovering else "clamped"
    title = f"Calibration of {vehicle.vehicle} by contact, hull {hull}, errors {vehicle.arm_errors}"
    truth = TrueArm(arm=true, tcp=np.zeros(3), hangs=True)

    # Nests that were touched more than once.
    repeated = [k for k, q in enumerate(session.series) if len(q) > 1]
    if len(repeated) < 2:
        raise ConfigurationError(
            "touching by contact: at least two nests must be found for a calibration, got fewer"
        )
    case = _simulated_case(
        title,
        source,
        [session.series[k] for k in repeated],
        session.p_WN[repeated],
        truth,
        known,
        rng,
    )

    reduced = replace(
        session,
        series=tuple(session.series[k] for k in repeated),
        hulls=tuple(session.hulls[k] for k in repeated),
    )
    return replace(
        case, session=reduced, X_BA=np.array(believed.vehicle.X_BA) if session.hovering else None
    )


def _simulated_case(
    title: str,
    source: ArmSource,
    series: Sequence[Array],
    places: Array,
    truth: TrueArm,
    known: bool,
    rng: np.random.Generator,
) -> CalibrationCase:
    distances = ()
    if known and len(places) > 1:
        i, j = farthest(places)
        length = float(np.linalg.norm(places[i] - places[j])) + LENGTH_ERROR * rng.standard_normal()
        distances = ((i, j, length, LENGTH_ERROR),)

    names = tuple(f"point{k + 1}" for k in range(len(series)))
    touches = Touches(series=tuple(readonly(q) for q in series), names=names, sha256="simulated")
    return CalibrationCase(
        title=title, source=source, touches=touches, distances=distances, truth=truth
    )
