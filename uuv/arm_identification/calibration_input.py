"""Input and evaluation of an arm calibration: arm and touches, from files or simulated, with the truth where known."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from scipy.stats import f

from uuv import models
from uuv.arm_identification.calibration_options import check_arm
from uuv.arm_identification.touching import Session, touch
from uuv.calib import verification
from uuv.calib.arm_files import ArmSource, read_arm
from uuv.calib.identification import Calibration, identify
from uuv.calib.loads import Loads
from uuv.calib.moving_base import BASE_JOINTS, in_own_names, on_moving_base, own_arm, own_parameters, with_base
from uuv.calib.simulation import EccentricGears, Sag, Seating, reach, read_by_encoders, true_joints, wrong_arm
from uuv.calib.touch_files import Touches, beyond_limits, read_touches
from uuv.calib.verdicts.doubts import Examination, coincide, examine
from uuv.calib.verdicts.evidence import Told
from uuv.components.deck_calibration import DOWN, LENGTH_ERROR, farthest, touched
from uuv.models.arms import dh_geometry, published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import GRAVITY, Array, finite_number, readonly
from uuv.sim.loop.rollout import Observer

_FOLDS, _LEAST_FOLD = 4, 12  # groups of points left out in turn; touches, less one a point, that the rest needs
TOOLS = {"straight": (0.0, 0.0, 0.15), "off-axis": (0.06, 0.0, 0.15)}  # [m] tip in the flange
# Tool direction in an arm's base whose z axis points up.
LOOKING_DOWN = (0.0, 0.0, -1.0)
# Errors of an arm as built in a workshop: theta, alpha, beta [rad], d, a [m].
WORKSHOP = {"theta": np.deg2rad(0.3), "d": 2e-3, "a": 2e-3, "alpha": np.deg2rad(0.3), "beta": np.deg2rad(0.3)}
# Errors left by a maker's own calibration: of the order of the 0.256 mm measured in [Yukhimets 2023] for its UR10e.
MAKERS = {"theta": np.deg2rad(0.02), "d": 2e-4, "a": 2e-4, "alpha": np.deg2rad(0.02), "beta": np.deg2rad(0.02)}

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueArm:
    """The true arm of a simulation; the calibration gets only its touches."""

    arm: SerialArm
    tcp: Array  # (3,) [m]
    hangs: bool  # z of its base points down
    sag: Sag | None = None  # elastic joints, under no payload
    gears: EccentricGears | None = None

    def stands_at(self, q: Array) -> Array:
        """Joint values (N, n) [rad] at which the joints truly stand where the encoders read `q`."""
        return true_joints(self.arm, q, sag=self.sag, gears=self.gears)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationCase:
    """Input of a calibration, and the data to evaluate it with."""

    title: str
    source: ArmSource  # nominal arm
    touches: Touches
    distances: tuple[tuple[int, int, float, float], ...] = ()
    held_out: Touches | None = None
    truth: TrueArm | None = None
    session: Session | None = None  # touching by contact
    loads: Loads | None = None  # under which the joints bend; None: compliances are not identified
    X_BA: Array | None = None  # (4, 4) arm base on a hull that moved during the touches; None: fixed base
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationOutcome:
    """A calibration with the figures of its evaluation."""

    calibration: Calibration
    arm: SerialArm  # identified, without the joints of a moving hull
    tcp: Array  # (3,) [m]
    series: tuple[Array, ...]  # joint values that were identified from
    clouds: dict[str, verification.Cloud] = field(default_factory=dict)
    held_out: dict[str, tuple[float, float]] = field(default_factory=dict)  # by point: RMS [m] nominal, identified
    covered: float | None = None  # share of the errors held out, along each axis, within their 95 % intervals
    half_width: float | None = None  # [m] median half-width of those intervals
    tips: tuple[Array, Array] | None = None  # (N,) [m] error of the tip in the base: nominal, identified
    uncorrected: dict[str, verification.Cloud] = field(default_factory=dict)  # hovering: hull motion ignored
    rigid: Calibration | None = None  # where compliances are identified: the same touches without them
    examined: Examination = field(
        default_factory=Examination
    )  # wrong inputs that explain the touches better, or as well
    worse: tuple[str, ...] = ()  # data on which the nominal arm is better beyond chance


def nominal(name: str, folder: Path, base: str | None, tip: str | None) -> ArmSource:
    """The nominal arm called `name`: a published arm, the arm of a vehicle, or a file.

    Args:
        name: Name or path.
        folder: A vehicle's MJCF is written there.
        base: Base link or body of a URDF or MJCF.
        tip: Tip link or site of a URDF or MJCF.

    Raises:
        ConfigurationError: The name is unknown, or the file is unusable.
    """
    check_arm(name)
    if name in published_arms.available():
        return ArmSource(
            path=Path(name), kind="dh", arm=published_arms.load(name), base="base", tip="flange", sha256=""
        )
    if name in models.available():
        file = folder / f"{name}.xml"
        file.write_text(models.load(name).to_xml(), encoding="utf-8")
        return read_arm(file, base=base, tip=tip)
    return read_arm(name, base=base, tip=tip)


@dataclass(frozen=True, slots=True, kw_only=True)
class Loading:
    """Weights on the arm, as given on the command line; its base stands upright, or hangs from a vehicle."""

    link_masses: tuple[float, ...] = ()  # [kg] empty: spread evenly along the links
    payload: tuple[float, ...] = ()  # [kg] at the tool, for each point; empty: none

    def on(self, source: ArmSource, points: int) -> Loads:
        """Loads on the arm of `source` over series of touches of so many points.

        Raises:
            ConfigurationError: Another number of masses than links, or of payloads than points.
        """
        n = len(source.arm.joint_types)
        for option, given, wanted in (("--link-mass", self.link_masses, n), ("--payload", self.payload, points)):
            if given and len(given) != wanted:
                raise ConfigurationError(f"{option}: {wanted} are needed, got {len(given)}")
            for value in given:
                finite_number(value, f"{option} [kg]", least=0.0, most=1e4)
        down = GRAVITY if source.kind == "mjcf" else -GRAVITY  # a vehicle's arm has its z axis downwards
        return Loads(
            link_masses=self.link_masses or None, payload_mass=list(self.payload) or 0.0, gravity=(0.0, 0.0, down)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RealEffects:
    """What real arms and sockets have and a kinematic model does not, for simulated touches."""

    compliance: float = 0.0  # [rad/(N m)] of every joint
    gears: float = 0.0  # [rad] spread of the amplitudes of eccentric gears
    seating: float = 0.0  # [m] spread of the seating errors of the ball along each axis


def from_files(
    source: ArmSource,
    touches: Sequence[Path],
    held_out: Sequence[Path],
    units: Literal["auto", "rad", "deg"],
    distances: Sequence[tuple[str, str, float]],
    limits: Literal["arm", "encoders"] = "arm",
) -> CalibrationCase:
    """Calibration case from the user's own touches.

    Args:
        source: Nominal arm.
        touches: CSV files, or folders of them.
        held_out: Touches for validation only.
        units: Unit of the angles.
        distances: Known distances: point, point, [m].
        limits: "encoders": the touches may be beyond the limits of the arm.

    Raises:
        ConfigurationError: A file is unusable, `distances` names an unknown point, or touches are beyond the limits
            and do not coincide either.
    """
    how = {"joint_types": source.arm.joint_types, "joint_names": source.arm.joint_names, "units": units}
    read = read_touches(touches, **how)
    rest = read_touches(held_out, **how) if held_out else None
    notes = [*source.notes, *read.notes, *(rest.notes if rest else ())]
    for each in (read, rest):
        if each is not None:
            notes += _beyond(source.arm, each, limits)
    pairs = []
    for first, second, length in distances:
        for name in (first, second):
            if name not in read.names:
                raise ConfigurationError(f"--distance: no point {name!r}; there are {', '.join(read.names)}")
        pairs.append((read.names.index(first), read.names.index(second), length, LENGTH_ERROR))
    return CalibrationCase(
        title=f"Calibration of {source.path.name}",
        source=source,
        touches=read,
        distances=tuple(pairs),
        held_out=rest,
        notes=tuple(notes),
    )


def _beyond(arm: SerialArm, read: Touches, limits: Literal["arm", "encoders"]) -> list[str]:
    """Notes on touches beyond the limits of the arm, which is wrong about them where the touches coincide.

    Raises:
        ConfigurationError: They do not coincide, and the encoders are not to be believed.
    """
    said = beyond_limits(read, arm.limits, ~arm.slides, arm.joint_names)
    if not said:
        return []
    if limits == "arm" and not coincide(arm, list(read.series)):
        raise ConfigurationError(
            f"{said[0]}: not joint values of this arm, or in another unit or order; --limits encoders if they are"
        )
    return [f"{line}: the encoders are believed, the limits of the arm look too narrow" for line in said]


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
    loading: Loading = Loading(),
) -> CalibrationCase:
    """Calibration case from simulated touches by hand of an arm with errors.

    The true arm is that of [Yukhimets 2023] for a UR10e, else one with workshop errors.

    Args:
        source: Nominal arm.
        points: Number of points.
        touches: Touches of each point.
        noise: [m] standard deviation of a touch along each axis.
        pin: Name in TOOLS.
        known: Give the distance between the two farthest points.
        errors: Seed of the workshop errors.
        rng: Draws points, touches and the error of the distance.
        real: Effects in the true arm and its sockets.
        loading: Weights under which they bend.

    Raises:
        ReachError: Too few points are reached.
    """
    drawing = np.random.default_rng(errors)
    if source.kind == "mjcf":
        arm = dh_geometry.with_errors(source.arm, drawing)
        # The tip site is the tip of the vehicle's own tool; an off-axis pin protrudes sideways from it.
        tcp = np.array([TOOLS[pin][0], 0.0, 0.0])
        hangs, title = True, f"Calibration of {source.path.stem}, built with workshop errors {errors}"
    else:
        tcp, hangs = np.array(TOOLS[pin]), False
        if source.path.name == "ur10e":
            theta, a, d, alpha = PAPER_UR10E.T
            rows = np.column_stack([np.deg2rad(theta), d * 1e-3, a * 1e-3, np.deg2rad(alpha)])
            arm = replace(SerialArm.from_dh(rows), limits=source.arm.limits)
            title = "Calibration of a UR10e as in [Yukhimets 2023]"
        else:
            arm = wrong_arm(source.arm, WORKSHOP, drawing)
            title = f"Calibration of {source.path.name}, built with workshop errors {errors}"
    series, places = touched(
        arm, tcp, arm.limits, rng, points=points, touches=touches, noise=noise, way=DOWN if hangs else LOOKING_DOWN
    )
    sag, gears, unloaded = None, None, None
    if real.compliance > 0.0:
        sag = Sag(compliance=np.full(arm.n, real.compliance), loads=loading.on(source, points))
        unloaded = replace(sag, loads=replace(sag.loads, payload_mass=0.0))
    if real.gears > 0.0:
        gears = EccentricGears.draw(real.gears, arm.n, drawing)
    if real.seating > 0.0:
        series = Seating.draw(real.seating, points, drawing).seat(arm, tcp, series)
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
    """Calibration case from touches by contact: the vehicle's built arm presses a pin into nests.

    Args:
        source: Nominal arm.
        scenario: As `touching_scenario` makes it.
        known: Give the distance between the two farthest nests.
        rng: Draws the error of that distance.
        watch: Makes a further observer of the loop for the compiled world.

    Raises:
        ConfigurationError: The vehicle lacks a part, or fewer than two nests were found.
        ReachError: The arm does not reach enough nests.
    """
    vehicle = scenario.vehicle
    session, own = touch(scenario, watch)
    nominal_arm = dh_geometry.read(own.model, ARM_BASE_BODY, TIP_SITE, exclude=own.passive_joints)
    true = dh_geometry.with_errors(nominal_arm, np.random.default_rng(vehicle.arm_errors))
    hull = "hovering" if session.hovering else "clamped"
    title = f"Calibration of {vehicle.vehicle} by contact, hull {hull}, errors {vehicle.arm_errors}"
    truth = TrueArm(arm=true, tcp=np.zeros(3), hangs=True)
    found = [k for k, one in enumerate(session.series) if len(one) > 1]
    if len(found) < 2:
        raise ConfigurationError("fewer than two nests were found; nothing can be calibrated")
    case = _simulated_case(title, source, [session.series[k] for k in found], session.p_WN[found], truth, known, rng)
    kept = replace(
        session, series=tuple(session.series[k] for k in found), hulls=tuple(session.hulls[k] for k in found)
    )
    return replace(case, session=kept, X_BA=np.array(own.vehicle.X_BA) if session.hovering else None)


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
    return CalibrationCase(title=title, source=source, touches=touches, distances=distances, truth=truth)


def solve(
    case: CalibrationCase, *, free: Sequence[str], prior: dict[str, float], method: Literal["map", "paper"]
) -> CalibrationOutcome:
    """Identifies the arm of a case and evaluates the result.

    The hull poses of navigation enter the fit where the hull moved.

    Args:
        case: Input.
        free: Free parameters; empty: all.
        prior: Prior standard deviations [rad], [m] by name; empty: from the data.
        method: Fit: maximum a posteriori, or as published [Yukhimets 2023].
    """
    series, arm = list(case.touches.series), case.source.arm
    options = {"prior": prior or None, "method": method, "distances": case.distances, "loads": case.loads}
    plain = identify(series, arm, free=list(free) or None, **options)
    if case.X_BA is None:
        outcome = _judged(case, plain, plain.arm, series)
        if method == "map":
            again = partial(identify, nominal=arm, free=list(free) or None, **{**options, "distances": ()})
            outcome = _examined(outcome, case, plain, again)
        if case.loads is None:
            return outcome
        words = [word for word in free if word != "compliance" and word not in {f"c{k + 1}" for k in range(arm.n)}]
        return replace(outcome, rigid=identify(series, arm, free=words or None, **{**options, "loads": None}))
    assert case.session is not None
    longer = on_moving_base(arm, case.X_BA)
    moved = [with_base(q, X) for q, X in zip(series, case.session.hulls, strict=True)]
    words = list(free) or own_parameters(longer)
    full = identify(moved, longer, free=words, **options)
    alone, found = own_arm(full.arm, case.X_BA), in_own_names(full, plain)
    outcome = _judged(case, found, alone, moved)
    if method == "map":
        again = partial(identify, nominal=longer, free=words, **{**options, "distances": ()})
        outcome = _examined(outcome, case, found, again)
    return replace(outcome, uncorrected=_clouds(case, plain.arm, plain, np.random.default_rng(0)))


def _examined(
    outcome: CalibrationOutcome, case: CalibrationCase, found: Calibration, again: Callable[..., Calibration]
) -> CalibrationOutcome:
    """The outcome with what its touches say against it, which are those of a longer arm where the hull moved."""
    series = list(outcome.series)
    told = Told(names=case.touches.names, distances=case.distances, base_joints=0 if case.X_BA is None else BASE_JOINTS)
    examined = examine(found, series, again, told)
    worse = _worse_points(case, found, series)
    if not examined.doubts:
        worse += _worse_predicted(found, series, again)
    return replace(outcome, examined=examined, worse=tuple(worse))


def _judged(case: CalibrationCase, found: Calibration, arm: SerialArm, series: Sequence[Array]) -> CalibrationOutcome:
    tips, tcp = None, found.tcp
    clouds: dict[str, verification.Cloud] = {}
    if case.truth is not None:
        clouds = _clouds(case, arm, found, np.random.default_rng(0))
        if case.truth.hangs:
            truth = case.truth
            q = np.vstack(case.touches.series)
            true = truth.arm.tips(truth.stands_at(q), truth.tcp)
            tips = (
                np.linalg.norm(case.source.arm.tips(q, truth.tcp) - true, axis=1),
                np.linalg.norm(arm.tips(q if found.loads is None else found.deflected(q), tcp) - true, axis=1),
            )
    held, covered, half_width = {}, None, None
    if case.held_out is not None:
        for name, q in zip(case.held_out.names, case.held_out.series, strict=True):
            held[name] = (_scatter(case.source.arm.tips(q, _first_tcp(case))), _scatter(found.tips(q)))
        if several := [q for q in case.held_out.series if len(q) > 1]:
            tips_found = [found.tips(q) for q in several]
            errors = np.abs(np.vstack([p - p.mean(axis=0) for p in tips_found]))
            half = np.vstack([found.half_widths(q) for q in several])
            covered, half_width = float(np.mean(errors < half)), float(np.median(half))
    return CalibrationOutcome(
        calibration=found,
        arm=arm,
        tcp=tcp,
        series=tuple(series),
        clouds=clouds,
        held_out=held,
        covered=covered,
        half_width=half_width,
        tips=tips,
    )


def _worse_points(case: CalibrationCase, found: Calibration, series: Sequence[Array]) -> list[str]:
    """Points, used or held out, about which the nominal arm brings the touches closer, beyond chance."""
    used = [weights > 0.0 for weights in found.weights]
    sets = [(case.touches.names, series, used, found.touched_tips(series))]
    if case.held_out is not None:
        held = case.held_out
        every = [np.ones(len(q), dtype=bool) for q in held.series]
        sets.append((held.names, held.series, every, [found.tips(q) for q in held.series]))
    out = []
    for names, touched_series, used, tips in sets:
        for name, q, mine, p in zip(names, touched_series, used, tips, strict=True):
            if mine.sum() < 2:
                continue
            before, after = _scatter(found.nominal.tips(q[mine], found.nominal_tcp)), _scatter(p[mine])
            if after > before * _chance(3 * (int(mine.sum()) - 1)):
                out.append(f"{name}: {1e3 * after:.3g} mm against {1e3 * before:.3g} by the nominal arm")
    return out


def _worse_predicted(found: Calibration, series: Sequence[Array], again: Callable[..., Calibration]) -> list[str]:
    """Whether points left out of the fit, all in turn, lie closer by the nominal arm, beyond chance."""
    if found.loads is not None:
        return []  # its payloads are those of all points
    folds = [range(k, len(series), _FOLDS) for k in range(min(_FOLDS, len(series)))]
    square, degrees = np.zeros(2), 0
    for fold in folds:
        rest = [q for i, q in enumerate(series) if i not in fold]
        if sum(len(q) - 1 for q in rest) < _LEAST_FOLD:
            return []
        other = again(rest)
        for i in fold:
            used = found.weights[i] > 0.0
            if used.sum() < 2:
                continue
            q = series[i][used]
            both = found.nominal.tips(q, found.nominal_tcp), other.tips(q)
            square += [used.sum() * _scatter(p) ** 2 for p in both]
            degrees += 3 * (int(used.sum()) - 1)
    before, after = np.sqrt(square / max(degrees, 1))
    if degrees and after > before * _chance(degrees):
        return [f"points left out of the fit: {1e3 * after:.3g} mm along an axis against {1e3 * before:.3g}"]
    return []


def _chance(degrees: int) -> float:
    """Ratio of two RMS values of so many degrees of freedom each that chance exceeds once in a thousand times."""
    return float(np.sqrt(f.isf(1e-3, degrees, degrees)))


def _first_tcp(case: CalibrationCase) -> Array:
    """Tool point (3,) [m] for the nominal arm: [Yukhimets 2023, eq. 16] on the touches of the calibration."""
    from uuv.calib.touches import first_tcp

    return first_tcp(case.source.arm, list(case.touches.series))


def _scatter(tips: Array) -> float:
    """RMS distance [m] of tips (m, 3) from their mean."""
    return _rms(tips - tips.mean(axis=0))


def _clouds(
    case: CalibrationCase, identified: SerialArm, found: Calibration, rng: np.random.Generator
) -> dict[str, verification.Cloud]:
    """Simulated tracker test of each arm model as in [Yukhimets 2023]: 13 flange points of equal attitude, no payload.

    The tracker sees the true arm with its gears and sag; models get the joint values that its encoders read.
    """
    truth = case.truth
    assert truth is not None
    q = moves(case.source.arm, truth.arm.limits, truth.hangs, case.touches.series, rng)
    measured = verification.track(truth.arm, truth.stands_at(q), rng)
    none = np.zeros(3)
    bent = q if found.loads is None else found.deflected(q)
    clouds = {"nominal": case.source.arm.tips(q, none), "identified": identified.tips(bent, none)}
    if not truth.hangs:  # a bought robot has its maker's own table, with errors
        clouds["controller"] = wrong_arm(truth.arm, MAKERS, rng).tips(q, none)
    return verification.compare(measured, clouds)


def moves(
    arm: SerialArm,
    limits: Array,
    hangs: bool,
    touched: Sequence[Array],
    rng: np.random.Generator,
    count: int = 13,
    tries: int = 60,
) -> Array:
    """Joint values (count, n) for flange points of equal attitude in a box.

    The box is that of [Yukhimets 2023] with the flange down. Where the arm does not reach it, the box lies about a
    touched pose, with the attitude of that pose.

    Args:
        arm: Nominal arm.
        limits: (n, 2) [rad] or [m].
        hangs: z of its base points down: the box lies about a touched pose at once.
        touched: Joint values (m_i, n) of touches.
        rng: Draws box and points.
        count: Number of points.
        tries: Draws for each box.

    Raises:
        ReachError: No box is found.
    """
    limits = np.clip(limits, -np.pi, np.pi)
    if not hangs:
        with suppress(ReachError):
            return verification.flange_poses(arm, rng, count, limits=limits)
    best: list[Array] = []
    for home in rng.permutation(np.vstack(touched))[:20]:
        X, found = arm.flange(home[None])[0], [home]
        R = np.ascontiguousarray(X[:3, :3])
        for _ in range(tries):
            q, goal = home.copy(), X[:3, 3] + 0.15 * arm.reach * rng.uniform(-1.0, 1.0, 3)
            reached = reach(arm, np.zeros(3), goal, R, q)
            if reached and np.all((q >= limits[:, 0]) & (q <= limits[:, 1])) and np.abs(q - home).max() < 0.5 * np.pi:
                found.append(q)
        if len(found) >= count:
            return np.array(found[:count])
        best = max(best, found, key=len)
    if len(best) < 4:
        raise ReachError("no box of flange points found within the joint limits")
    return np.array(best)


def failed(outcome: CalibrationOutcome, method: Literal["map", "paper"]) -> list[str]:
    """Reasons to reject the identified arm; empty: accepted.

    Convergence counts for `method` "map" only: the published three iterations do not converge.
    """
    found, out = outcome.calibration, [str(doubt) for doubt in outcome.examined.doubts]
    if not found.cost < found.cost_nominal:
        out.append("the touches of a point lie no closer than by the nominal arm")
    if outcome.clouds and not outcome.clouds["identified"].rms <= outcome.clouds["nominal"].rms:
        out.append("the tracker finds the nominal arm better")
    if outcome.held_out:
        before, after = np.median(list(outcome.held_out.values()), axis=0)
        if not after <= before:
            out.append("the touches held out lie no closer than by the nominal arm")
    if outcome.worse:
        out.append(f"the nominal arm is better ({'; '.join(outcome.worse)})")
    if method == "map" and not found.converged:
        out.append(f"the fit did not settle in {len(found.history) - 1} steps")
    return out


def figures_of_merit(case: CalibrationCase, outcome: CalibrationOutcome) -> list[tuple[str, str]]:
    """Names and formatted values for the terminal and the report."""
    found, rank = outcome.calibration, outcome.calibration.rank
    touches = sum(len(each) for each in found.residuals)
    out = [
        ("touches, points, left out", f"{touches}, {len(found.residuals)}, {len(found.outliers)}"),
        ("touches of reduced weight", str(sum(int(((w > 0.0) & (w < 1.0)).sum()) for w in found.weights))),
        ("J before, after [mm²]", f"{1e6 * found.cost_nominal:.4g}, {1e6 * found.cost:.4g}"),
        ("touch noise, each axis [mm]", f"{1e3 * found.noise:.4f}"),
        ("identified directions", f"{rank.rank} of {rank.total}"),
        ("scale", _scale(case, outcome)),
    ]
    if case.loads is not None:
        out.append(("compliances [µrad/(N m)]", _compliances(found)))
    for label, clouds in (
        ("tracker RMS", outcome.clouds),
        ("tracker RMS, hull's motion left aside", outcome.uncorrected),
    ):
        if clouds:
            before, after = clouds["nominal"].rms, clouds["identified"].rms
            out.append((f"{label}: nominal, identified [mm]", f"{1e3 * before:.4f}, {1e3 * after:.4f}"))
            if "controller" in clouds:
                out.append((f"{label}: a maker's own table [mm]", f"{1e3 * clouds['controller'].rms:.4f}"))
            out.append((f"{label}: ratio", f"{before / max(after, 1e-12):.2f}"))
    if outcome.tips is not None:
        before, after = (1e3 * np.sqrt((each**2).mean()) for each in outcome.tips)
        out.append(("tip in the base, RMS: nominal, identified [mm]", f"{before:.3f}, {after:.3f}"))
    if outcome.held_out:
        values = 1e3 * np.array(list(outcome.held_out.values()))
        out += [
            (f"held out, {name}: nominal, identified [mm]", f"{before:.3f}, {after:.3f}")
            for name, (before, after) in zip(outcome.held_out, values, strict=True)
        ]
        out.append(("held out, median: nominal, identified [mm]", "{:.3f}, {:.3f}".format(*np.median(values, axis=0))))
    if outcome.covered is not None and outcome.half_width is not None:
        interval = f"{100.0 * outcome.covered:.1f} %, ± {1e3 * outcome.half_width:.3f}"
        out.append(("held out, within the 95 % interval; its median [mm]", interval))
    if case.session is not None:
        session = case.session
        out += [
            ("touched for [s], nests missed", f"{session.simulated_s:.0f}, {session.missed}"),
            ("seat of the pin, true spread [mm]", f"{1e3 * session.tip_spread:.4f}"),
            ("hull, largest true motion between touches [mm]", f"{1e3 * session.hull_motion:.3f}"),
        ]
    return out


def _compliances(found: Calibration) -> str:
    """Compliance of each joint and half of its 95 % interval; a dash where the loads do not show it."""
    half = dict(zip(found.names, found.quantile() * found.sigma, strict=True))
    hidden = {name for group in found.rank_free.hidden for name in group.names}
    told = []
    for k, value in enumerate(found.compliance, start=1):
        known = f"c{k}" in half and f"c{k}" not in hidden
        told.append(f"{1e6 * value:.1f} ± {1e6 * half[f'c{k}']:.1f}" if known else "-")
    return ", ".join(told)


def _scale(case: CalibrationCase, outcome: CalibrationOutcome) -> str:
    """Accuracy of the arm's scale, which only a known distance determines."""
    if not case.distances:
        return "not told: no distance is known"
    longest = max(case.distances, key=lambda one: one[2])
    found = outcome.calibration
    i, j, length, deviation = longest
    ends = found.noise / np.sqrt(min(len(found.residuals[i]), len(found.residuals[j])))
    ppm = 1e6 * float(np.hypot(deviation, np.sqrt(2.0) * ends)) / length
    return f"by {len(case.distances)} known, the longest {length:.3f} m: ± {ppm:.0f} ppm"


def _pairs(outcome: CalibrationOutcome) -> dict[str, float]:
    """Distances of the touches of a point in all pairs [Yukhimets 2023, fig. 4]."""
    found, series = outcome.calibration, list(outcome.series)
    before = verification.pair_distances([found.nominal.tips(q, found.nominal_tcp) for q in series])
    after = verification.pair_distances(found.touched_tips(series))
    return {
        "count": len(before),
        "nominal_mean_m": float(before.mean()),
        "identified_mean_m": float(after.mean()),
        "ten_times_closer": float(np.mean(before > 10.0 * after)),
    }


def _stages(clouds: dict[str, verification.Cloud]) -> dict[str, Any]:
    """Clouds of flange points against the tracker's through the stages of [Yukhimets 2023, fig. 5 to 8]."""
    tracker = clouds["tracker"]

    def stage(name: str) -> dict[str, float]:
        cloud = clouds[name]
        return {
            "raw_m": _rms(cloud.raw - tracker.raw),
            "centred_m": _rms(cloud.centred - tracker.centred),
            "aligned_m": cloud.rms,
            "most_m": float(cloud.deviations.max()),
        }

    closer = clouds["identified"].deviations < clouds["nominal"].deviations
    stages = {name: stage(name) for name in clouds if name != "tracker"}
    return {"points": len(tracker.raw), "closer": int(closer.sum()), **stages}


def _rms(offsets: Array) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


def metrics(case: CalibrationCase, outcome: CalibrationOutcome, ok: bool, seed: int) -> dict[str, Any]:
    """Contents of metrics.json: SI units, null where a figure does not exist.

    Args:
        case: Input.
        outcome: Result.
        ok: The result is accepted.
        seed: Seed of the run.
    """
    found, rank, clouds, session = outcome.calibration, outcome.calibration.rank, outcome.clouds, case.session
    return {
        "title": case.title,
        "seed": seed,
        "accepted": ok,
        "untold": list(outcome.examined.untold),
        "touches": {
            "count": sum(len(each) for each in found.residuals),
            "points": len(found.residuals),
            "reduced": sum(int(((weights > 0.0) & (weights < 1.0)).sum()) for weights in found.weights),
            "left_out": len(found.outliers),
            "sha256": case.touches.sha256,
            "noise_m": float(found.noise),
        },
        "fit": {
            "cost_nominal_m2": float(found.cost_nominal),
            "cost_m2": float(found.cost),
            "steps": len(found.history) - 1,
            "converged": bool(found.converged),
            "compliance_rad_nm": found.compliance.tolist() if case.loads is not None else None,
            "warnings": list(found.warnings),
        },
        "rank": {
            "identified": rank.rank,
            "of": rank.total,
            "hidden": [{"count": g.count, "names": list(g.names), "reason": g.reason} for g in rank.hidden],
        },
        "tracker": {name: clouds[name].rms for name in ("nominal", "identified")} if clouds else None,
        "pairs": _pairs(outcome),
        "tracker_stages": _stages(clouds) if clouds else None,
        "tracker_uncorrected_m": outcome.uncorrected["identified"].rms if outcome.uncorrected else None,
        "held_out_m": {name: {"nominal": a, "identified": b} for name, (a, b) in outcome.held_out.items()} or None,
        "contact": None
        if session is None
        else {
            "simulated_s": session.simulated_s,
            "missed": session.missed,
            "seat_spread_m": session.tip_spread,
            "hull_motion_m": session.hull_motion,
        },
        "parameters": {
            name: {"value": value, "change": change, "sigma": sigma, "unit": unit}
            for name, value, change, sigma, unit in zip(
                found.names,
                found.estimate.values.tolist(),
                found.estimate.changes.tolist(),
                found.sigma.tolist(),
                found.estimate.parameters.units,
                strict=True,
            )
        },
    }
