"""Verdict on each job: whether a vehicle can begin it, and the figure that decides.

A job of the arm is checked in this order: parts, a push far beyond the capacity of arm or
thrusters, view, and then the job's own planner. The planner searches for a hull pose beside the
object, which is at its true pose, in the job's current. If there is no such hull pose, a tip force
or thrust that is too small is given as the reason. All numbers are those of the job's own options.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from uuv.check.checked_jobs import ARM_JOBS
from uuv.check.conditions import Conditions
from uuv.check.findings import JobVerdict
from uuv.check.hovering import RestVerdict, listed, refused, rest_of
from uuv.check.ready_force import BEYOND, VIEW, ReadyForce, looks_by_camera, push_of
from uuv.check.remedies import Change, changes_for
from uuv.check.statics import Listing, listing_of, tip_force
from uuv.check.way_in import met_on_the_way
from uuv.controllers.hull.allocation import MOST_LIST, undriven_axes
from uuv.controllers.planning.arm_size import FULL
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.arrival import around, unfolding_way
from uuv.controllers.tasks.grasping.collecting import straight_down
from uuv.controllers.tasks.insertion import axis_path
from uuv.models.completing.postures import PostureSearch
from uuv.models.naming import lacks
from uuv.models.tools.gripper import FINGERS
from uuv.models.vehicle import Vehicle
from uuv.models.water import battery_feed
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perception.finding.target_finder import PATH_SPACING
from uuv.perception.seabed.terrain_path import core_path
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.scenario import PlacedTask, Scenario
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import (
    ConfigurationError,
    OverloadError,
    OverloadHereError,
    ReachError,
    StrongCurrentError,
    UuvError,
)
from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.spatial import Array, transform_points
from uuv.tasks.collecting import PlacedCollection
from uuv.tasks.insertion import PlacedInsertion
from uuv.tasks.plugging import MovePlugTask, PlacedMove
from uuv.tasks.seabed_sampling import PlacedSampling, sonar_on_hull
from uuv.tasks.start_place import RunStreams, clearance, folded_at, start_pose, start_refusal
from uuv.tasks.surface_work import PlacedSurfaceWork
from uuv.tasks.turning import PlacedTurn, TurnValveTask

PROMISED = 0.95  # share of the drawn poses from which on a job is promised
FEW = 5  # poses that a refusal takes at least, and at which another option is tried
SHORT_MARGIN = 0.5  # least margin of an arm of fewer than six joints
FRICTION = 0.6  # friction of the tool on a surface, as a share of the set force
HIDDEN = 0.1  # share of the ground about a target that may be hidden from the sonar
Watch = Callable[[str, int, int], None]  # job, poses that are done, of how many
SMALL_PAD = 50.0  # [N] at the tip in its weakest direction, under which the small pad is proposed


class ArmJobs:
    """Verdicts on the jobs of one vehicle's arm."""

    def __init__(
        self,
        vehicle: str,
        *,
        tool: str | None = None,
        parts: str | None = None,
        conditions: Conditions | None = None,
        override: mujoco.MjSpec | None = None,
        watch: Watch | None = None,
    ) -> None:
        """Take a vehicle by its name or file.

        Args:
            vehicle: As the option --vehicle of the jobs.
            tool: As --tool.
            parts: As --parts.
            conditions: Poses of the object, and options of the jobs.
            override: Spec of the vehicle, with its tool and battery, in place of the one that its
                name stands for.
            watch: Called with the job, the poses that are done, and how many there are.
        """
        self.conditions = Conditions() if conditions is None else conditions
        self._vehicle = vehicle
        self._tool = tool
        self._parts = parts
        self._override = override
        self._watch = watch
        # by tools and current: station keeping is simulated once
        self._rest: dict[Any, RestVerdict] = {}

    def scenario(self, name: str, changes: Mapping[str, Any] | None = None) -> Scenario:
        """Scenario of a job for the vehicle; `changes` are further options of the job."""
        job = ARM_JOBS[name]
        conditions = self.conditions
        options = {**conditions.options, **(changes or {})}
        scenario = job(
            vehicle=self._vehicle,
            **{word: value for word, value in options.items() if job.takes(word)},
        )

        # a job with its own tool adds that tool itself
        tool = self._tool if scenario.task.tool is None else None
        flow = conditions.flow
        site = scenario.site if flow is None else replace(scenario.site, flow=flow)
        setup = replace(scenario.vehicle, parts=self._parts, tool=tool, battery=conditions.battery)
        return replace(scenario, site=site, vehicle=setup, seed=conditions.seed)

    def verdict(self, name: str, blocked: float) -> JobVerdict:
        """Verdict on a job; a refusal names an option with which it is feasible, if one is found.

        Args:
            name: Name of the job.
            blocked: Share of the camera's view that is on the vehicle itself.
        """
        try:
            place = self._at_site(name, blocked)
            if isinstance(place, JobVerdict):
                return self._mended(name, blocked, place)
            verdicts = self._judged(name, place)
        except UuvError as error:
            return refused(name, "parts", str(error))

        verdict = of_poses(verdicts)
        bad = [pose for pose, judged in enumerate(verdicts) if not judged.promised]
        return verdict if verdict.promised else self._mended(name, blocked, verdict, bad)

    def _at_site(
        self, name: str, blocked: float, changes: Mapping[str, Any] | None = None
    ) -> "Callable[[int], JobVerdict] | JobVerdict":
        """Function that judges the job at a pose, or a refusal that holds for all poses."""
        scenario = self.scenario(name, changes)
        task = scenario.task
        setup = scenario.vehicle
        vehicle = setup.vehicle if self._override is None else self._override
        spec = vehicle_spec(vehicle, setup.tool, setup.parts, task.tool)
        if setup.battery is not None and self._override is None:
            battery_feed.attach(spec, setup.battery)
        model = spec.compile()
        lacking = lacks(model, task.spares)
        if lacking:
            hint = _tool_hint(model) if "geom" in " ".join(lacking) else ""
            return refused(name, "parts", f"lacks {', '.join(lacking)}{hint}")

        believed = OwnVehicle.of(spec, task.spares)
        joints = len(believed.vehicle.joints)
        if joints < FULL and isinstance(task, MovePlugTask | TurnValveTask):
            message = (
                f"what the tool holds fixes its axes against the hull's drift: an arm of {joints} "
                f"joints cannot follow, at least {FULL} are needed"
            )
            return refused(name, "joints", message, float(joints))
        if (weak := ReadyForce.of(scenario, believed).refusal(BEYOND)) is not None:
            return refused(name, *weak)
        if (hidden := _view(name, scenario, blocked)) is not None:
            return hidden

        # the hull is about there
        water = tuple(scenario.site.strongest_water(np.zeros(3)).tolist())
        key = setup.tool, task.tool, water
        if key not in self._rest:
            self._rest[key] = rest_of(name, hydrodynamics.compile(spec.copy()), water)
        rest = self._rest[key]
        if rest.refusal is not None:
            return replace(rest.refusal, job=name)

        def judged(pose: int) -> JobVerdict:
            drawn = replace(scenario, seed=scenario.seed + pose)
            return _planned(name, drawn, believed, spec, rest.swing)

        return judged

    def _judged(self, name: str, place: "Callable[[int], JobVerdict]") -> list[JobVerdict]:
        """Verdicts at the poses, until too many are refused for a promise, at FEW at least."""
        verdicts: list[JobVerdict] = []
        spare = int((1.0 - PROMISED) * self.conditions.poses + 1e-9)
        for pose in range(self.conditions.poses):
            verdicts.append(place(pose))
            if self._watch is not None:
                self._watch(name, len(verdicts), self.conditions.poses)
            if len(verdicts) >= FEW and sum(not v.promised for v in verdicts) > spare:
                break
        return verdicts

    def _mended(
        self, name: str, blocked: float, verdict: JobVerdict, bad: Sequence[int] = (0,)
    ) -> JobVerdict:
        """The refusal, extended by an option that makes the job feasible, or by options that do
        not.

        Args:
            name: Of the job.
            blocked: As of `verdict`.
            verdict: The refusal.
            bad: Poses at which it is refused, which are tried first.
        """
        poses = [*bad, *(pose for pose in range(self.conditions.poses) if pose not in bad)][:FEW]

        def passes(change: Change, tried: Sequence[int]) -> bool:
            try:
                place = self._at_site(name, blocked, change.options)
            except UuvError:
                return False
            return not isinstance(place, JobVerdict) and all(place(p).promised for p in tried)

        # What the largest change of an option does not mend, no smaller one will.
        vain = []
        for changes in changes_for(verdict.code, name, self.scenario(name)):
            if not passes(changes[-1], poses[:1]):
                vain.append(changes[-1].typed)
                continue
            for change in changes:
                if passes(change, poses):
                    where = "1 pose" if len(poses) == 1 else f"{len(poses)} poses"
                    line = f"{verdict.said}; feasible with {change.typed} at the {where} tried"
                    return replace(verdict, said=line, remedy=change.typed)
            vain.append(changes[-1].typed)

        if not vain:
            return verdict
        return replace(
            verdict, said=f"{verdict.said}; not feasible either with {' or '.join(vain)}"
        )


def of_poses(verdicts: list[JobVerdict]) -> JobVerdict:
    """Verdict on a job from its verdicts at drawn poses: share of passes, worst, main refusal."""
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
    return refused(
        name,
        "view",
        f"{blocked:.0%} of the camera's view is blocked by the vehicle itself, above the limit of "
        f"{VIEW:.0%}",
    )


def _planned(
    name: str, scenario: Scenario, believed: OwnVehicle, spec: mujoco.MjSpec, swing: float
) -> JobVerdict:
    """Verdict by the job's own planner, for the object at its true pose.

    Args:
        name: Of the job.
        scenario: With the seed of the pose.
        believed: The vehicle's model of itself.
        spec: Of the vehicle.
        swing: [m] by which its points move while it settles.
    """
    rng = np.random.default_rng(scenario.seed)
    try:
        placed = scenario.task.place(scenario, believed, rng)
    except OverloadError as error:
        return refused(name, error.setting, str(error), error.most)
    scene = placed.scene(spec.copy()).compile()
    if (lies := _start(scene, placed, RunStreams.of(rng).start, swing)) is not None:
        return refused(name, "start", *lies)

    current = scenario.site.strongest_water(placed.X_WB[:3, 3])
    speed = float(np.linalg.norm(current))

    try:
        placement, share, way, bound = _stand(placed, current)
    except StrongCurrentError as error:
        return refused(name, "current", str(error), speed)
    except OverloadHereError as error:
        return refused(name, error.setting, str(error), error.most)
    except ReachError as error:
        if (weak := ReadyForce.of(scenario, believed).refusal()) is not None:
            return refused(name, *weak)

        joints = len(believed.vehicle.joints)
        more = f"; the arm has {joints} joints" if joints < FULL else ""
        return refused(
            name, "reach", f"{_short(str(error))}{more}", float(joints) if more else None
        )

    if (refusal := _at_placement(name, placed, believed, placement.margin)) is not None:
        return refusal

    if way and (met := met_on_the_way(scene, Vehicle.of(scene), way, placement)) is not None:
        return refused(name, "way", *met)

    listing = _worst_list(spec, believed.vehicle, placement.q_start, push_of(scenario))
    if listing is not None and not listing.angle <= MOST_LIST:
        return listed(name, listing)

    part = "" if share > 0.999 else f", {share:.0%} of the path"
    return JobVerdict(
        job=name,
        promised=True,
        code="ok",
        said=f"margin {placement.margin:.2f} (1 is ample, 0 at a limit) at "
        f"{push_of(scenario):.0f} N in {speed:.2f} m/s{part}{bound}"
        + _touching(believed, placement.q_start)
        + ("" if listing is None else f"; {listing.in_words()}"),
        figure=placement.margin,
    )


def _at_placement(
    name: str, placed: PlacedTask, believed: OwnVehicle, margin: float
) -> JobVerdict | None:
    """Refusal of the planned place, for hidden ground or a small margin; None if there is none."""
    if isinstance(placed, PlacedSampling) and (hidden := _hidden(placed, believed)) > HIDDEN:
        message = (
            f"the vehicle hides {hidden:.0%} of the ground around the target from its sonar, "
            f"above the limit of {HIDDEN:.0%}"
        )
        return refused(name, "view", message, hidden)

    if len(believed.vehicle.joints) < FULL and margin < SHORT_MARGIN:
        message = (
            f"margin {margin:.2f}; an arm of {len(believed.vehicle.joints)} joints needs "
            f"{SHORT_MARGIN:g}: it compensates the hull's drift by its posture alone"
        )
        return refused(name, "margin", message, margin)
    return None


def _start(
    scene: mujoco.MjModel, placed: PlacedTask, rng: np.random.Generator, swing: float
) -> tuple[str, float] | None:
    """Sentence and clearance [m] if there is no room at the start, or on the way to the task's
    pose.
    """
    vehicle = Vehicle.of(scene)
    start = start_pose(placed, rng)
    if lies := start_refusal(scene, vehicle, start):
        return lies, clearance(scene, vehicle, start).distance

    # It settles about the task's pose, its arm sags, and it may swing on the way.
    nearest = min(
        (clearance(scene, vehicle, X_WB) for X_WB in (start, placed.X_WB)),
        key=lambda clear: clear.distance,
    )
    if nearest.distance >= swing:
        return None
    message = f"the vehicle starts {nearest}, and moves by {swing:.2f} m while it settles"
    return message, nearest.distance


def _worst_list(
    spec: mujoco.MjSpec, vehicle: Vehicle, q_start: Array, push: float
) -> Listing | None:
    """Largest list in the ready posture and at the start of work, for all directions of friction.

    None: thrusters drive all axes.
    """
    if not undriven_axes(vehicle.thruster_wrench):
        return None
    model = hydrodynamics.compile(spec.copy())
    lists = [listing_of(model, vehicle, q_start, force) for force in pushes_with_friction(push)]
    lists.append(listing_of(model, vehicle, np.array(vehicle.q_ready)))

    # A hull that turns over has no angle.
    listed = [listing for listing in lists if listing is not None]
    return max(listed, key=lambda listing: np.nan_to_num(listing.angle, nan=np.inf))


def pushes_with_friction(push: float) -> Array:
    """Forces (8, 3) [N] on the tip, tool axes: a push [N], with friction in all directions."""
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    drag = FRICTION * push * np.array([np.cos(angles), np.sin(angles)])
    return np.column_stack([*drag, np.full(len(angles), -push)])


def _touching(believed: OwnVehicle, q: Array) -> str:
    """Note on self-contacts at joint angles `q` (n,), which no planner refuses."""
    pairs = PostureSearch(believed.model).touching(q)
    names = [(believed.model.body(a).name, believed.model.body(b).name) for a, b in pairs]

    # Closed jaws touch each other.
    named = sorted(f"{a} and {b}" for a, b in names if {a, b} != {*FINGERS})
    return f"; self-contact at the work pose: {', '.join(named)}" if named else ""


def _hidden(placed: PlacedSampling, believed: OwnVehicle) -> float:
    """Share of the ground around target 1 that the vehicle hides from its sonar at the start."""
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


def _stand(placed: PlacedTask, current: Array) -> tuple[Placement, float, list[Array], str]:
    """Best hull pose, share of the path worked from it, the hull's way to the pose at which the
    arm unfolds: poses (4, 4) from the scan on, empty without an object, and what arm and thrusters
    can give there, in words, where the job computes it.
    """
    way: list[Array] = []
    words = ""
    if isinstance(placed, PlacedSurfaceWork):
        X_WT = placed.truth.X_WT
        path = path_on_model(X_WT, placed.target.path(placed.truth.path), spacing=PATH_SPACING)
        target = _target(X_WT, path)
        stand = placed.standing(target, path, current)
        believed = placed.own.at_work()

        path_in = around(believed, placed.target)(target)
        lift = placed.job().arrival.lift
        way = [placed.X_WB, *unfolding_way(believed, path_in, stand[0].X_WB, placed.X_WB, lift)]
    elif isinstance(placed, PlacedInsertion):
        path = axis_path(placed.X_WT, placed.bore, placed.task.depth)
        stand = placed.planner().stand(_target(placed.X_WT, path), path, current)
    elif isinstance(placed, PlacedCollection):
        planner = placed.planner()
        path = straight_down(placed.X_WT, placed.choice)
        stand = planner.stand(_target(placed.X_WT, path), path, current)
    elif isinstance(placed, PlacedTurn):
        planner = placed.planner()
        target = planner.with_path(_target(placed.X_WT, None))
        assert target.path is not None
        stand = planner.stand(target, target.path, current)
        bound = planner.bound(target, stand[1], stand[0])
        words = f"; it can give {bound.in_words('N m')}"
    elif isinstance(placed, PlacedMove):
        planner = placed.planner()
        target = planner.with_path(_target(placed.X_WT, None))
        assert target.path is not None
        stand = planner.stand(target, target.path, current)
        pull, push = (planner.bound(stand[1], stand[0], sign) for sign in (1.0, -1.0))
        words = f"; it can pull with {pull.in_words('N')} and push with {push.in_words('N')}"
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

    return stand[0], float(stand[2]), way, words


def _points(placed: PlacedSampling, B: Array) -> Array:
    """Points (V, 3) [m] of the ground around a target."""
    half = min(2.0, placed.ground.half - 0.3)
    grid = np.arange(-half, half, 0.03)
    xy = np.array([(x, y) for x in grid for y in grid]) + B[:2]
    z = placed.ground.height(xy)
    return np.column_stack([xy, z])[np.isfinite(z)]


def _target(X_WT: Array, path: ToolPath | None) -> Target:
    at = float(np.linalg.norm(transform_points(X_WT, np.zeros(3))))
    return Target(time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=at, reason="", path=path)
