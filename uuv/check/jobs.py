"""Verdict on each job: whether a vehicle can begin it, and the figure that decides.

A job of the arm is checked in this order: parts, a push far beyond the capacity of arm or
thrusters, view, and then the job's own planner. The planner searches for a hull pose beside the
object, which is at its true pose, in the job's current. If there is no such hull pose, a tip force
or thrust that is too small is given as the reason. All numbers are those of the job's own options.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from uuv.check.checked_jobs import ARM_JOBS, HOVERING
from uuv.check.findings import JobVerdict
from uuv.check.hover import HoverFigures, hover
from uuv.check.ready_force import BEYOND, VIEW, ReadyForce, looks_by_camera, push_of
from uuv.check.statics import Listing, listing_of, tip_force
from uuv.controllers.hull.allocation import MOST_LIST, undriven_axes
from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.arrival import around, lifted
from uuv.controllers.tasks.hull_phases import RestLimits
from uuv.controllers.tasks.insertion import axis_path
from uuv.models.completing.postures import PostureSearch
from uuv.models.naming import lacks
from uuv.models.vehicle import Vehicle
from uuv.models.water import battery_feed
from uuv.models.water.battery import Battery
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perception.finding.target_finder import PATH_SPACING
from uuv.perception.seabed.terrain_path import core_path
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.scenario import PlacedTask, Scenario
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, ReachError, StrongCurrentError, UuvError
from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.spatial import Array, transform_points
from uuv.sim.water.flow_field import FlowField
from uuv.tasks.insertion import PlacedInsertion
from uuv.tasks.seabed_sampling import PlacedSampling, sonar_on_hull
from uuv.tasks.start_place import check_start, folded_at
from uuv.tasks.surface_work import PlacedSurfaceWork

PROMISED = 0.95  # least share of drawn poses that pass, for a promised job
DRIFT = 0.1  # [m] largest position error of a vehicle that keeps station
TILT = float(np.radians(10.0))  # [rad] its largest tilt
SATURATED = 0.3  # largest share of the time in which a thruster may be at its limit
SHORT_MARGIN = 0.5  # least margin of an arm of fewer than six joints
FRICTION = 0.6  # friction of the tool on a surface, as a share of the set force
HIDDEN = 0.1  # share of the ground about a target that may be hidden from the sonar
SMALL_PAD = 50.0  # [N] tip force in the weakest direction, below which the small pad is proposed


def hover_verdict(name: str, model: mujoco.MjModel) -> JobVerdict:
    """Verdict on station keeping: by statics, if an axis is undriven, and then by simulation."""
    vehicle = Vehicle.of(model)
    listing = listing_of(model, vehicle, np.array(vehicle.q_home))
    if listing is not None and not listing.angle <= MOST_LIST:
        return _listed(name, listing)
    hovered = _hovering(model, HOVERING[name])
    if isinstance(hovered, JobVerdict):
        return replace(hovered, job=name)
    verdict = _kept(name, hovered)
    return (
        verdict
        if listing is None
        else replace(verdict, said=f"{verdict.said}; {listing.in_words()}")
    )


def _listed(name: str, listing: Listing) -> JobVerdict:
    """Refusal of a hull that lists too far."""
    reason = f"{listing.in_words()} (limit {np.degrees(MOST_LIST):.0f} deg)"
    return _refused(name, "list", reason, float(np.degrees(listing.angle)))


def _hovering(
    model: mujoco.MjModel, current: tuple[float, float, float]
) -> HoverFigures | JobVerdict:
    """Figures of station keeping; a refusal if the vehicle cannot be controlled at all."""
    try:
        return hover(model, current)
    except UuvError as error:
        return JobVerdict(job="hover", promised=False, code="thrust", said=str(error))


def _kept(name: str, hovered: HoverFigures) -> JobVerdict:
    power = "" if hovered.power is None else f", {hovered.power:.0f} W"
    figures = (
        f"{1e3 * hovered.drift:.0f} mm position error, {np.degrees(hovered.tilt):.1f} deg, "
        f"{hovered.saturated:.0%} saturated{power}"
    )

    if hovered.said:
        return JobVerdict(
            job=name, promised=False, code="hover", said=hovered.said, figure=hovered.drift
        )

    bounds = ((hovered.drift, DRIFT), (hovered.tilt, TILT), (hovered.saturated, SATURATED))
    good = all(value <= most for value, most in bounds)
    text = (
        figures
        if good
        else (
            f"{figures}; limits {1e3 * DRIFT:.0f} mm, {np.degrees(TILT):.0f} deg, {SATURATED:.0%}"
        )
    )

    return JobVerdict(
        job=name, promised=good, code="ok" if good else "hover", said=text, figure=hovered.drift
    )


def restless(
    name: str, model: mujoco.MjModel, current: tuple[float, float, float]
) -> JobVerdict | None:
    """Refusal of a vehicle that cannot keep station or come to rest in a job's current."""
    hovered = _hovering(model, current)
    speed = float(np.linalg.norm(current))
    verdict = hovered if isinstance(hovered, JobVerdict) else _kept(name, hovered)

    if not verdict.promised:
        return _refused(
            name,
            verdict.code,
            f"no station keeping in {speed:.2f} m/s: {verdict.said}",
            verdict.figure,
        )

    limits = RestLimits()
    if isinstance(hovered, HoverFigures) and hovered.rest < limits.time:
        message = (
            f"in {speed:.2f} m/s the hover is not steady for {limits.time:g} s: {hovered.turn:.2g} "
            f"rad/s (limit {limits.turn:g}); check minimum thrust and dead band of the thrusters"
        )
        return _refused(name, "rest", message, hovered.turn)

    return None


class ArmJobs:
    """Verdicts on the jobs of one vehicle's arm."""

    def __init__(
        self,
        vehicle: str,
        *,
        tool: str | None,
        parts: str | None,
        forces: Sequence[float] = (),
        flow: FlowField | None = None,
        poses: int = 1,
        battery: Battery | None = None,
    ) -> None:
        """Take a vehicle by its name or file.

        Args:
            vehicle: Value of the jobs' option --vehicle.
            tool: Value of --tool.
            parts: Value of --parts.
            forces: [N] set forces in place of the jobs' own.
            flow: Flow field that is added to the jobs' current.
            poses: Number of poses of the object that are drawn, with the seeds from 0 on.
            battery: Battery of the thrusters; None: their voltage is constant.
        """
        self._battery = battery
        self._vehicle = vehicle
        self._tool = tool
        self._flow = flow
        self._poses = poses
        self._parts = parts
        self.forces = tuple(forces)
        # verdict by tools and current, for which station keeping is simulated once
        self._rest: dict[Any, JobVerdict | None] = {}

    def scenario(self, name: str) -> Scenario:
        """Scenario of a job for the vehicle."""
        options: dict[str, Any] = {"vehicle": self._vehicle}
        if self.forces and ARM_JOBS[name].takes_forces:
            options["forces"] = self.forces
        scenario = ARM_JOBS[name](**options)

        # a job with its own tool adds that tool itself
        tool = self._tool if scenario.task.tool is None else None
        site = replace(scenario.site, flow=self._flow) if self._flow is not None else scenario.site
        vehicle = replace(scenario.vehicle, parts=self._parts, tool=tool, battery=self._battery)
        return replace(scenario, site=site, vehicle=vehicle)

    def verdict(
        self, name: str, blocked: float, override: mujoco.MjSpec | None = None
    ) -> JobVerdict:
        """Verdict on a job.

        Args:
            name: Name of the job.
            blocked: Share of the camera's view that is on the vehicle itself.
            override: Spec of the vehicle, in place of the one that its name refers to.
        """
        scenario = self.scenario(name)
        task = scenario.task
        setup = scenario.vehicle

        try:
            vehicle = setup.vehicle if override is None else override
            spec = vehicle_spec(vehicle, setup.tool, setup.parts, task.tool)
            if setup.battery is not None:
                battery_feed.attach(spec, setup.battery)
            model = spec.compile()
            lacking = lacks(model, task.spares)
            if lacking:
                hint = _tool_hint(model) if "geom" in " ".join(lacking) else ""
                return _refused(name, "parts", f"lacks {', '.join(lacking)}{hint}")

            believed = OwnVehicle.of(spec, task.spares)
            if (refused := ReadyForce.of(scenario, believed).refusal(scenario, BEYOND)) is not None:
                return _refused(name, *refused)
            if (hidden := _view(name, scenario, blocked)) is not None:
                return hidden
            # evaluated at the origin, near the hull
            water = tuple(scenario.site.strongest_water(np.zeros(3)).tolist())
            key = setup.tool, task.tool, water
            if key not in self._rest:
                self._rest[key] = restless(name, hydrodynamics.compile(spec.copy()), water)
            if (moving := self._rest[key]) is not None:
                return replace(moving, job=name)

            seeds = range(scenario.seed, scenario.seed + self._poses)
            return of_poses(
                [_planned(name, replace(scenario, seed=seed), believed, spec) for seed in seeds]
            )
        except UuvError as error:
            return _refused(name, "parts", str(error))


def of_poses(verdicts: list[JobVerdict]) -> JobVerdict:
    """Verdict on a job from its verdicts at drawn poses: share that pass, worst, main refusal."""
    if len(verdicts) == 1:
        return verdicts[0]
    good = [verdict for verdict in verdicts if verdict.promised]
    bad = [verdict for verdict in verdicts if not verdict.promised]
    share = len(good) / len(verdicts)
    line = f"{len(good)} of {len(verdicts)} poses"

    # The worst of the poses that pass, and the most frequent reason of the others.
    if good:
        worst = min(good, key=lambda verdict: verdict.figure or 0.0)
        line += f"; worst: {worst.said}"
    if bad:
        code, count = Counter(verdict.code for verdict in bad).most_common(1)[0]
        first = next(verdict for verdict in bad if verdict.code == code)
        line += f"; {count} refused for {code}: {first.said}"

    whole = good[0] if good else bad[0]
    return replace(
        whole,
        promised=share >= PROMISED,
        code="ok" if share >= PROMISED else Counter(v.code for v in bad).most_common(1)[0][0],
        said=line,
        figure=min((verdict.figure or 0.0 for verdict in good), default=whole.figure),
        share=share,
    )


def _refused(job: str, code: str, message: str, figure: float | None = None) -> JobVerdict:
    return JobVerdict(job=job, promised=False, code=code, said=message, figure=figure)


def _tool_hint(model: mujoco.MjModel) -> str:
    try:
        vehicle = Vehicle.of(model)
        if vehicle.tip < 0:
            return ""
        bears = tip_force(model, vehicle, np.array(vehicle.q_ready)).weakest
    except UuvError:
        return ""
    return f"; try --tool {'small_pad' if bears < SMALL_PAD else 'pad'}"


def _view(name: str, scenario: Scenario, blocked: float) -> JobVerdict | None:
    if not looks_by_camera(scenario) or blocked <= VIEW:
        return None
    return _refused(
        name,
        "view",
        f"{blocked:.0%} of the camera's view is blocked by the vehicle itself, above the limit of "
        f"{VIEW:.0%}",
    )


def _planned(
    name: str, scenario: Scenario, believed: OwnVehicle, spec: mujoco.MjSpec
) -> JobVerdict:
    """Verdict by the job's own planner, for the object at its true pose."""
    placed = scenario.task.place(scenario, believed, np.random.default_rng(scenario.seed))
    scene = placed.scene(spec.copy()).compile()
    try:
        check_start(scene, Vehicle.of(scene), placed.X_WB)
    except ConfigurationError as error:
        return _refused(name, "start", str(error))

    current = scenario.site.strongest_water(placed.X_WB[:3, 3])
    speed = float(np.linalg.norm(current))

    try:
        placement, share, gap = _stand(placed, current)
    except StrongCurrentError as error:
        return _refused(name, "current", str(error), speed)
    except ReachError as error:
        if (refused := ReadyForce.of(scenario, believed).refusal(scenario)) is not None:
            return _refused(name, *refused)

        joints = len(believed.vehicle.joints)
        more = f"; the arm has {joints} joints" if joints < FULL else ""
        return _refused(
            name, "reach", f"{_short(str(error))}{more}", float(joints) if more else None
        )

    margin = placement.margin
    if isinstance(placed, PlacedSampling) and (hidden := _hidden(placed, believed)) > HIDDEN:
        message = (
            f"the vehicle hides {hidden:.0%} of the ground around the target from its sonar, "
            f"above the limit of {HIDDEN:.0%}"
        )
        return _refused(name, "view", message, hidden)

    if len(believed.vehicle.joints) < FULL and margin < SHORT_MARGIN:
        message = (
            f"margin {margin:.2f}; an arm of {len(believed.vehicle.joints)} joints needs "
            f"{SHORT_MARGIN:g}: it compensates the hull's drift by its posture alone"
        )
        return _refused(name, "margin", message, margin)

    listing = _worst_list(spec, believed.vehicle, placement.q_start, push_of(scenario))
    if listing is not None and not listing.angle <= MOST_LIST:
        return _listed(name, listing)

    part = "" if share > 0.999 else f", {share:.0%} of the path"
    return JobVerdict(
        job=name,
        promised=True,
        code="ok",
        said=f"margin {margin:.2f} (1 is ample, 0 at a limit) at {push_of(scenario):.0f} N in "
        f"{speed:.2f} m/s{part}"
        + _touching(believed, placement.q_start)
        + ("" if listing is None else f"; {listing.in_words()}")
        + (
            f"; during close-in the folded arm or the hull penetrates the convex hull of the "
            f"object by {-gap:.2f} m"
            if gap < 0.0
            else ""
        ),
        figure=margin,
    )


def _worst_list(
    spec: mujoco.MjSpec, vehicle: Vehicle, q_start: Array, push: float
) -> Listing | None:
    """Largest list in the ready posture and at the start of work, for all directions of friction.

    None: thrusters drive all axes.
    """
    if not undriven_axes(vehicle.thruster_wrench):
        return None
    model = hydrodynamics.compile(spec.copy())
    drag = FRICTION * push
    forces = [np.array([x, y, -push]) for x in (-drag, drag) for y in (-drag, drag)]
    lists = [listing_of(model, vehicle, q_start, force) for force in forces]
    lists.append(listing_of(model, vehicle, np.array(vehicle.q_ready)))

    # A hull that turns over has no angle.
    listed = [listing for listing in lists if listing is not None]
    return max(listed, key=lambda listing: np.nan_to_num(listing.angle, nan=np.inf))


def _touching(believed: OwnVehicle, q: Array) -> str:
    """Note on self-contacts at joint angles `q` (n,), which no planner refuses."""
    pairs = PostureSearch(believed.model).touching(q)
    named = sorted(
        f"{believed.model.body(a).name} and {believed.model.body(b).name}" for a, b in pairs
    )
    return f"; self-contact at the work pose: {', '.join(named)}" if named else ""


def _hidden(placed: PlacedSampling, believed: OwnVehicle) -> float:
    """Share of the ground about target 1 that the vehicle hides from its sonar at the start."""
    model, vehicle = believed.model, believed.vehicle
    data = folded_at(model, vehicle, placed.start)
    p_W = (placed.start @ sonar_on_hull(believed.hull_box))[:3, 3]

    # Points on the ground in two rings about the target.
    B = np.array(placed.B_W[0])
    B[2] = float(placed.ground.height(B[None])[0])
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    about = [
        B,
        *(B + r * np.array([np.cos(a), np.sin(a), 0.0]) for r in (0.1, 0.2) for a in angles),
    ]

    met = np.zeros(1, dtype=np.int32)
    nothing = -1.0
    hits = [
        mujoco.mj_ray(model, data, p_W, point - p_W, None, 1, vehicle.hull, met) != nothing
        and met[0] >= 0
        for point in about
    ]

    return float(np.mean(hits))


def _short(message: str) -> str:
    """The part of a planner's message about its best hull pose, without the sentence before it."""
    _, marker, best = message.partition("at best ")
    share, _, why = best.partition("%")
    return f"at best {share}% of the path is within reach{why}" if marker else message


def _stand(placed: PlacedTask, current: Array) -> tuple[Placement, float, float]:
    """Best hull pose, share of the path worked from it, and least clearance [m] of close-in.

    The clearance is between hull or folded arm and the convex hull of the object.
    """
    gap = np.inf
    if isinstance(placed, PlacedSurfaceWork):
        X_WT = placed.truth.X_WT
        path = path_on_model(X_WT, placed.target.path(placed.truth.path), spacing=PATH_SPACING)
        target = _target(X_WT, path)
        stand = placed.standing(target, path, current)
        believed = placed.own.at_work()

        before = lifted(believed, stand[0].X_WB, placed.X_WB, placed.job().arrival.lift)
        path_in = around(believed, placed.target)(target)
        gap = path_in.least_gap([placed.X_WB, *path_in.way(placed.X_WB, before)])
    elif isinstance(placed, PlacedInsertion):
        path = axis_path(placed.X_WT, placed.bore, placed.task.depth)
        stand = placed.planner().stand(_target(placed.X_WT, path), path, current)
    elif isinstance(placed, PlacedSampling):
        # The first target, at the true height of the ground.
        B = np.array(placed.B_W[0])
        B[2] = float(placed.ground.height(B[None])[0])
        path = core_path(B, np.array([0.0, 0.0, -1.0]), placed.start[:3, 0], placed.job.depth)
        stand = placed.planner().stand(
            replace(_target(np.eye(4), path), ground=_points(placed, B)), path, current
        )
    else:
        raise ConfigurationError(f"the check has no rule for tasks of {type(placed).__name__}")

    return stand[0], float(stand[2]), gap


def _points(placed: PlacedSampling, B: Array) -> Array:
    """Points (V, 3) [m] of the ground around a target."""
    half = min(2.0, placed.ground.half - 0.3)
    grid = np.arange(-half, half, 0.03)
    xy = np.array([(x, y) for x in grid for y in grid]) + B[:2]
    z = placed.ground.height(xy)
    return np.column_stack([xy, z])[np.isfinite(z)]


def _target(X_WT: Array, path: ToolPath) -> Target:
    at = float(np.linalg.norm(transform_points(X_WT, np.zeros(3))))
    return Target(time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=at, reason="", path=path)
