"""The supervisor's states under scripted estimates: a hull that is where it should be, and a force
that is told.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from scripted_world import ScriptedWorld
from uuv import models
from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.mkps import Chain
from uuv.controllers.planning import hull_placement
from uuv.controllers.planning.placement import Placement
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.controllers.safety.blind_departure import ascent_direction
from uuv.controllers.tasks.arrival import ArrivalLimits, ScanLimits
from uuv.controllers.tasks.contact_phases import ApproachLimits
from uuv.controllers.tasks.hull_phases import Settle
from uuv.controllers.tasks.surface_work import SurfaceTaskConfig, SurfaceWork
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.objects.targets import barrel
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError, ReachError, StrongCurrentError
from uuv.sim.interfaces.messages import (
    AbortCode,
    ContactEstimate,
    Fault,
    FaultKind,
    Reference,
    Target,
    ToolPath,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

PERIOD, FINE = 0.04, 0.01  # [s] enough for most that is asked here; that of jobs
SCAN_POSE = pose(p=[-1.0, 0.2, 0.5])
WORK_POSE = pose(p=[-0.6, 0.0, 0.3])
JOURNEY = [
    WorkState.SETTLE,
    WorkState.SCAN,
    WorkState.CLOSE_IN,
    WorkState.TARE,
    WorkState.APPROACH,
    WorkState.PRESS,
    WorkState.WORK,
    WorkState.RETREAT,
]
IN_CONTACT = [WorkState.APPROACH, WorkState.PRESS, WorkState.WORK]
STIFFNESS = 3e4  # [N/m] of the pad


def straight(length: float = 0.12) -> ToolPath:
    """Along x, the tool looking down."""
    s = np.linspace(0.0, length, 41)
    ones = np.ones((41, 1))
    return ToolPath(
        s=s,
        p=s[:, None] * [1.0, 0.0, 0.0],
        z=ones * [0.0, 0.0, -1.0],
        x=ones * [1.0, 0.0, 0.0],
        on_scan=np.ones(41, dtype=bool),
    )


def tip(reference: Reference) -> Array:
    assert reference.X_WG is not None
    return reference.X_WG[:3, 3]


def target(time: float, accepted: bool = True, x: float = 0.0) -> Target:
    path = straight()
    return Target(
        time=time,
        X_WT=pose(p=[x, 0.0, 0.0]),
        accepted=accepted,
        check_m=0.001,
        range_m=1.2,
        reason="" if accepted else "too few points",
        path=replace(path, p=path.p + np.array([x, 0.0, 0.0])) if accepted else None,
    )


def obedient(reference: Reference) -> float:
    """A surface where it is expected, then a force control without error."""
    if reference.state is WorkState.APPROACH:
        return STIFFNESS * max(0.0, -float(tip(reference)[2]))
    return reference.set_force


@dataclass
class Script(ScriptedWorld):
    """Drives a supervisor; every reference that it gives is kept."""

    job: SurfaceTaskConfig = field(
        default_factory=lambda: SurfaceTaskConfig(forces=(60.0, 90.0, 60.0))
    )
    felt: Callable[[Reference], float] = obedient  # [N] from the last reference
    looks: Sequence[bool] = (True,) * 6  # whether each look finds the object
    finds: Sequence[float] = (0.0,) * 6  # [m] where along x it finds it
    doubted: float = 1.0  # [m] where along x a look that does not find it shows something
    holding: ThrustMargin | None = None
    side: bool = False  # the vehicle with its arm on the side
    fastest: float = np.inf  # [m/s] of the hull, whatever is asked of it
    fastest_after: float = np.inf  # [m/s] the same once a thruster is dead
    dead: int | None = None  # thruster that is found dead
    # half-way along the path
    dead_from: Callable[[Reference], bool] = lambda reference: reference.path_s > 0.06
    sigma: float = np.inf  # [N] stated standard deviation of the normal force; inf: none
    # share of the felt force that is felt across the tool too; None: that is not known
    friction: float | None = None
    hollow: tuple[float, float] | None = None  # [m] part of the path on which the tool does not fit
    period: float = PERIOD  # [s] of the planner
    looking: Iterator[bool] = field(init=False)
    offsets: Iterator[float] = field(init=False)
    known: tuple[Fault, ...] = field(default=(), init=False)

    def run(self, seconds: float = 180.0) -> "Script":
        model = models.load("uuv_puma_side" if self.side else "uuv_puma").compile()
        chain = Chain.from_mjcf(model, ARM_BASE_BODY, TIP_SITE, exclude=["pad"])
        vehicle = Vehicle.of(model)
        planner = SurfaceWork(
            WorkVehicle(vehicle=vehicle, chain=chain, hull_box=np.zeros((2, 3))),
            barrel(),
            self.job,
            X_WB_scan=SCAN_POSE,
            period=self.period,
            holding=self.holding,
        )
        self.looking, self.offsets = iter(self.looks), iter(self.finds)
        return self.drive(planner, SCAN_POSE, seconds, vehicle.q_home)

    def look(self, time: float) -> Target | None:
        accepted = next(self.looking, None)
        if accepted is None:
            return None

        seen = target(time, accepted, next(self.offsets) if accepted else self.doubted)
        if self.hollow is None or seen.path is None:
            return seen
        s, (first, last) = seen.path.s, self.hollow
        fits = (s < first) | (s > last)
        return replace(seen, path=replace(seen.path, fits=fits, note="a hollow"))

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        del time
        return self._contact(self.felt(reference))

    def faults(self, reference: Reference, time: float) -> tuple[Fault, ...]:
        if self.dead is not None and not self.known and self.dead_from(reference):
            self.known = (Fault(kind=FaultKind.THRUSTER, part="", index=self.dead, time=time),)
            self.fastest = min(self.fastest, self.fastest_after)
        return self.known

    def over(self, reference: Reference) -> bool:
        return super().over(reference) and len(self.of(reference.state)) > 20

    def hull_at(self, X_WB: Array, reference: Reference) -> Array:
        way = reference.X_WB[:3, 3] - X_WB[:3, 3]
        length = float(np.linalg.norm(way))
        if length <= self.fastest * self.period:
            return reference.X_WB
        share = self.fastest * self.period / length
        return pose(reference.X_WB[:3, :3], X_WB[:3, 3] + way * share)

    def _contact(self, felt: float) -> ContactEstimate:
        estimate = ContactEstimate(normal=felt, sigma_G=np.array([1.0, 1.0, self.sigma]))
        if self.friction is None:
            return estimate
        return replace(estimate, force_W=felt * np.array([self.friction, 0.0, 1.0]))


@pytest.fixture(autouse=True)
def placed(monkeypatch: pytest.MonkeyPatch) -> list[ToolPath]:
    """Placement has its own tests: here every path is within reach from WORK_POSE.

    The paths asked for.
    """
    paths: list[ToolPath] = []

    def place(vehicle: Vehicle, chain: Chain, path: ToolPath, **options: Any) -> Placement:
        del chain, options
        paths.append(path)
        return Placement(
            X_WB=WORK_POSE,
            travel_W=np.zeros(3),
            roll=0.0,
            q_start=vehicle.q_ready,
            margin=1.0,
            reached=1.0,
        )

    monkeypatch.setattr(hull_placement, "place_hull", place)
    return paths


@pytest.fixture(scope="module")
def smooth() -> Script:
    """One job without trouble."""
    with pytest.MonkeyPatch.context() as patch:
        placement = Placement(
            X_WB=WORK_POSE,
            travel_W=np.zeros(3),
            roll=0.0,
            q_start=np.array([0.0, 0.15, 1.2, 0.2, 0.0, 0.0]),
            margin=1.0,
            reached=1.0,
        )
        patch.setattr(hull_placement, "place_hull", lambda *_, **__: placement)
        return Script().run()


def test_states_follow_each_other(smooth):
    assert smooth.states == [*JOURNEY, WorkState.DONE]
    assert smooth.end.note == ""
    assert {r.state for r in smooth.references if r.scan} == {WorkState.SCAN}
    assert {r.state for r in smooth.references if r.tare} == {WorkState.TARE}
    assert len([r for r in smooth.references if r.tare]) == pytest.approx(2.0 / PERIOD, abs=2)
    # the last as long as it lets go
    pressing = {WorkState.PRESS, WorkState.WORK, WorkState.RETREAT}
    assert {r.state for r in smooth.references if r.force_control} == pressing
    assert {r.state for r in smooth.references if r.set_force > 0.0} == pressing


def test_the_tool_moves_along_the_path_at_work_only_and_all_of_it(smooth):
    for before, after in zip(smooth.references, smooth.references[1:], strict=False):
        assert after.path_s == before.path_s or after.state is WorkState.WORK
    assert smooth.end.path_s == pytest.approx(0.12)
    rates = np.diff([r.path_s for r in smooth.of(WorkState.WORK)]) / PERIOD
    assert rates.min() >= 0.0
    assert rates.max() == pytest.approx(smooth.job.speed, rel=1e-6)


def test_the_way_up_leads_off_every_surface(rng):
    normals = rng.normal(size=(200, 3))
    for normal in normals / np.linalg.norm(normals, axis=1)[:, None]:
        assert normal @ ascent_direction(normal) >= 0.5 - 1e-12
        assert normal[2] < -0.5 or ascent_direction(normal)[2] > 0.0
    assert ascent_direction(np.array([0.0, 0.0, 1.0])) == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.parametrize("surface", [0.02, 0.0, -0.03])  # [m] above where it is expected
def test_tool_reference_is_continuous_and_its_velocity_the_derivative(surface):
    """From the tare to the end, wherever the surface is met: a jump would go straight into it, or
    tear off it.
    """

    def felt(reference: Reference) -> float:
        if reference.state is WorkState.APPROACH:
            return STIFFNESS * max(0.0, surface - float(tip(reference)[2]))
        return reference.set_force

    script = Script(felt=felt, period=FINE).run()
    moving = script.of(WorkState.TARE, *IN_CONTACT, WorkState.RETREAT, WorkState.DONE)
    steps = np.linalg.norm(np.diff([tip(r) for r in moving], axis=0), axis=1)
    assert steps.max() <= 1.01 * script.job.approach.speed * FINE
    for state in (WorkState.APPROACH, WorkState.WORK):
        places, velocity = (
            np.array([what(r) for r in script.of(state)]) for what in (tip, lambda r: r.v_WG_W)
        )
        central = 0.5 * (places[2:] - places[:-2]) / FINE
        assert np.abs(velocity[1:-1] - central).max() < 3e-4  # half a step of the acceleration
    # Away from the surface that was met, and from the one that was expected.
    assert tip(script.end)[2] >= max(surface, 0.0) + script.job.approach.standoff - 2e-3


def test_surface_is_met_at_touch_speed(smooth):
    last = smooth.of(WorkState.APPROACH)[-1]
    assert np.linalg.norm(last.v_WG_W) == pytest.approx(smooth.job.approach.touch_speed)
    fastest = max(float(np.linalg.norm(r.v_WG_W)) for r in smooth.of(WorkState.APPROACH))
    assert fastest == pytest.approx(smooth.job.approach.speed)


def test_set_force_is_ramped_and_changes_with_the_part_of_the_path(smooth):
    contact = smooth.of(WorkState.PRESS, WorkState.WORK)
    force = np.array([r.set_force for r in contact])
    assert np.abs(np.diff(force)).max() <= smooth.job.force_rate * PERIOD * (1.0 + 1e-9)
    share = np.array([r.path_s for r in contact]) / 0.12
    assert np.all(force[(share > 0.0) & (share < 1 / 3)] == 60.0)
    assert np.all(force[(share > 0.6) & (share < 2 / 3)] == 90.0)
    assert np.all(force[share > 0.95] == 60.0)


def test_force_is_let_go_before_the_tool_leaves(smooth):
    """What is dropped at 60 N rebounds from a hard surface."""
    off = smooth.of(WorkState.RETREAT)
    down = [reference for reference in off if reference.force_control]
    force = np.array([reference.set_force for reference in down])
    assert force[0] > 0.9 * 60.0
    assert np.all(np.abs(np.diff(force) / PERIOD + smooth.job.force_rate) < 1e-6)
    assert force[-1] < smooth.job.approach.touch + smooth.job.force_rate * PERIOD
    assert all(np.array_equal(tip(reference), tip(down[0])) for reference in down)
    assert not any(reference.force_control for reference in off[len(down) :])
    assert np.linalg.norm(tip(off[-1]) - tip(down[0])) > 0.09


@pytest.mark.parametrize("state", [WorkState.PRESS, WorkState.WORK])
def test_in_trouble_the_tool_leaves_at_once(state):
    script = Script(felt=lambda last: 170.0 if last.state is state else obedient(last)).run()
    assert not any(reference.force_control for reference in script.of(WorkState.RETREAT))


def test_a_knock_is_not_a_contact(smooth):
    """Felt for less than `touch_time`, again and again, in free water: the approach goes on to the
    surface.
    """
    knocks = iter(range(10**6))

    def felt(reference: Reference) -> float:
        if reference.state is WorkState.APPROACH and tip(reference)[2] > 0.0:
            return 30.0 if next(knocks) % 10 < 3 else 0.0  # 30 ms of 40 ms
        return obedient(reference)

    script = Script(felt=felt, period=FINE).run()
    assert script.states == smooth.states
    assert tip(script.of(WorkState.APPROACH)[-1])[2] <= 0.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"touch_speed": 0.0}, "task.approach.touch_speed: .*positive"),
        ({"speed": np.nan}, "task.approach.speed: .*nan"),
        ({"guard": 0.014}, r"task.approach.guard: must exceed the 0.0147 m .*got 0.014 m"),
    ],
)
def test_an_approach_that_would_hang_or_overrun_is_refused(change, said):
    with pytest.raises(ConfigurationError, match=said):
        ApproachLimits(**change)


def test_contact_starts_the_press_wherever_it_is_met():
    def felt(reference: Reference) -> float:  # the surface 20 mm nearer than expected
        if reference.state is WorkState.APPROACH:
            return STIFFNESS * max(0.0, 0.02 - float(tip(reference)[2]))
        return reference.set_force

    script = Script(felt=felt).run()
    assert script.states == [*JOURNEY, WorkState.DONE]
    met = script.of(WorkState.PRESS)[0]
    assert tip(met)[2] == pytest.approx(0.02, abs=1.5e-3)
    # The press begins from the force that is felt, not from nothing.
    assert met.set_force >= script.job.approach.touch


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_no_motion_along_the_path_before_the_force_is_reached(share):
    script = Script(
        felt=lambda r: share * r.set_force if r.state is WorkState.PRESS else obedient(r)
    ).run()
    assert script.states == [*JOURNEY[:6], WorkState.RETREAT, WorkState.ABORT]
    assert script.end.path_s == 0.0
    assert "did not settle at 60 N within 6 s" in script.end.note
    assert len(script.of(WorkState.PRESS)) * PERIOD == pytest.approx(6.0, abs=0.1)


def test_force_must_be_held_before_the_work_begins():
    """Reached only every other tenth of a second: never for the half second that it takes."""
    ticks = iter(range(10**6))

    def felt(reference: Reference) -> float:
        if reference.state is WorkState.PRESS:
            return reference.set_force * (1.0 if next(ticks) % 20 < 10 else 0.8)
        return obedient(reference)

    assert WorkState.WORK not in Script(felt=felt).run().states


def test_without_force_control_the_work_begins_all_the_same():
    job = SurfaceTaskConfig(forces=(60.0,), force_control=False)
    script = Script(
        job=job, felt=lambda r: 20.0 if r.state in IN_CONTACT[1:] else obedient(r)
    ).run()
    assert script.states == [*JOURNEY, WorkState.DONE]


@pytest.mark.parametrize("state", IN_CONTACT)
def test_too_much_force_ends_in_a_retreat(state):
    def felt(reference: Reference) -> float:
        return 119.0 if reference.state is state else obedient(reference)

    script = Script(felt=felt).run()
    reached = JOURNEY[: JOURNEY.index(state) + 1]
    assert script.states == [*reached, WorkState.RETREAT, WorkState.ABORT]
    assert len(script.of(state)) <= 2  # at once
    # 90 N, a quarter more, and the touch
    assert "119 N is above the limit of 118 N" in script.end.note
    lifted = tip(script.end) - tip(script.of(WorkState.RETREAT)[0])
    assert lifted[2] >= 0.95 * script.job.approach.standoff
    assert script.end.set_force == 0.0
    assert not script.end.force_control


@pytest.mark.parametrize(("sigma", "ends"), [(np.inf, "abort"), (1.2, "abort"), (2.0, "done")])
def test_force_counts_as_reached_within_the_noise_that_is_stated(sigma: float, ends: str):
    """Noise of 4 N is more than 5 % of the set force; it is judged by what the estimate says of
    itself.
    """
    signs = cycle((1.0, 1.0, -1.0, 0.0))

    def felt(reference: Reference) -> float:
        return obedient(reference) + (
            4.0 * next(signs) if reference.state is WorkState.PRESS else 0.0
        )

    script = Script(felt=felt, sigma=sigma).run()
    assert script.end.state == ends
    assert script.end.abort is (AbortCode.FORCE_NOT_REACHED if ends == "abort" else None)


@pytest.mark.parametrize(("gap", "ends"), [(0.4, WorkState.DONE), (0.7, WorkState.ABORT)])
def test_contact_may_be_lost_for_a_moment(gap, ends):
    def felt(reference: Reference) -> float:
        lost = 2.0 < 100.0 * reference.path_s < 2.0 + 2.0 * gap  # at 2 cm/s
        return 0.0 if reference.state is WorkState.WORK and lost else obedient(reference)

    script = Script(felt=felt).run()
    assert script.end.state is ends
    assert ("contact lost for 0.5 s" in script.end.note) is (ends is WorkState.ABORT)


@pytest.mark.parametrize(("felt_share", "ends"), [(0.6, WorkState.DONE), (0.4, WorkState.ABORT)])
def test_contact_is_lost_below_half_of_a_small_set_force(felt_share: float, ends: WorkState):
    """3 N, less than the touch of 6 N: half of the touch would be the set force itself."""

    def felt(reference: Reference) -> float:
        share = felt_share if reference.state is WorkState.WORK and reference.path_s > 0.02 else 1.0
        return share * obedient(reference)

    script = Script(job=SurfaceTaskConfig(forces=(3.0,)), felt=felt).run()
    assert script.end.state is ends
    assert ("contact lost for 0.5 s" in script.end.note) is (ends is WorkState.ABORT)


@pytest.mark.parametrize(
    ("time", "share", "ends"), [(0.2, 1.5, "done"), (0.5, 1.5, "abort"), (5.0, 1.2, "done")]
)
def test_force_may_be_above_the_set_one_for_a_moment(time: float, share: float, ends: str):
    def felt(reference: Reference) -> float:
        more = 2.0 < 100.0 * reference.path_s < 2.0 + 2.0 * time  # at 2 cm/s
        return (share if reference.state is WorkState.WORK and more else 1.0) * obedient(reference)

    script = Script(felt=felt).run()
    assert script.end.state == ends
    assert ("the force cannot be held" in script.end.note) is (ends == "abort")


def test_no_surface_where_one_should_be():
    script = Script(felt=lambda _: 0.0).run()
    assert script.states == [*JOURNEY[:5], WorkState.RETREAT, WorkState.ABORT]
    deepest = min(float(tip(r)[2]) for r in script.of(WorkState.APPROACH))
    assert deepest == pytest.approx(-script.job.approach.search, abs=1e-3)
    assert "no contact within 0.06 m" in script.end.note


def test_another_view_when_the_first_shows_nothing():
    script = Script(looks=(False, *(True,) * 6)).run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN, *JOURNEY, WorkState.DONE]
    first, *others = (r for r in script.references if r.state is WorkState.SCAN and r.scan)
    for other in others:
        assert np.linalg.norm(other.X_WB[:3, 3] - first.X_WB[:3, 3]) > 0.2


@pytest.mark.parametrize(
    ("looks", "finds", "mean"),
    [
        ((True,) * 6, (0.0, 4e-3, 0.0, 8e-3, 0.0, 6e-3), 3e-3),
        # what is not found at a look is left out
        ((True, False, True, False, True, False), (0.0, 4e-3, 2e-3), 2e-3),
        ((True, False, False, True, False, False), (5e-3, 5e-3), 5e-3),
    ],
)
def test_mean_of_several_finds_is_worked(looks, finds, mean):
    script = Script(looks=looks, finds=finds).run()
    assert script.states == [*JOURNEY, WorkState.DONE]
    times = [r.time for r in script.references if r.scan]
    assert len(times) == 6
    assert np.diff(times) == pytest.approx(np.full(5, script.job.arrival.scan.interval), abs=0.05)
    worked = np.array([tip(r)[0] for r in script.of(WorkState.WORK)])
    assert worked[0] == pytest.approx(mean, abs=1e-4)


@pytest.mark.parametrize(
    ("looks", "finds", "said"),
    [
        (
            (True,) * 6,
            (0.0, 0.2, 0.4, 0.0, 0.2, 0.4),
            "6 detections within 20 s differ by up to 400 mm, 2 of them agree",
        ),
        ((True, True, *(False,) * 4), (0.0, 0.0), "identified, but in none of 4 later views"),
    ],
)
def test_an_object_that_moves_is_not_worked(looks, finds, said):
    job = SurfaceTaskConfig(forces=(60.0,), arrival=ArrivalLimits(scan=ScanLimits(views=1)))
    script = Script(looks=looks, finds=finds, job=job).run()
    assert script.end.abort is AbortCode.OBJECT_MOVES
    assert said in script.end.note
    assert WorkState.CLOSE_IN not in script.states


def test_an_object_that_is_seen_again_in_doubt_rests():
    """Far away the noise of the sensor leaves most looks doubtful, though at the same place."""
    job = SurfaceTaskConfig(forces=(60.0,), arrival=ArrivalLimits(scan=ScanLimits(views=1)))
    looks = (True, *(False,) * 5)
    seen_again = Script(looks=looks, finds=(2e-3,), doubted=0.01, job=job).run()
    assert seen_again.states == [*JOURNEY, WorkState.DONE]
    worked = np.array([tip(r)[0] for r in seen_again.of(WorkState.WORK)])
    assert worked[0] == pytest.approx(2e-3, abs=1e-4)
    assert Script(looks=looks, doubted=0.2, job=job).run().end.abort is AbortCode.OBJECT_MOVES


def test_finds_that_are_not_repeated_ask_for_another_view():
    script = Script(looks=(True, *(False,) * 5, *(True,) * 6), finds=(0.0,) * 7).run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN, *JOURNEY, WorkState.DONE]


@pytest.mark.parametrize("bears", [True, False])
def test_thrusters_that_may_not_hold_against_friction_are_told_and_that_cannot_hold_at_all_refused(
    bears, monkeypatch
):
    drags: list[float] = []
    arm_alone = hull_placement.place_hull

    def place(*args: Any, holding: ThrustMargin, **options: Any) -> Placement:
        drags.append(holding.drag)
        if holding.drag or not bears:
            raise ReachError("out of reach")
        return arm_alone(*args, **options)

    monkeypatch.setattr(hull_placement, "place_hull", place)
    script = Script(holding=ThrustMargin.of(models.load("uuv_puma").compile())).run()
    assert script.end.state is (WorkState.DONE if bears else WorkState.ABORT)
    assert drags[0] == 0.6
    assert drags[-1] == 0.0
    assert ("thrusters may not hold" in script.end.note) == bears


def test_a_current_that_is_too_strong_is_refused_before_the_arm_unfolds(monkeypatch):
    def stand(*_: Any) -> tuple[Placement, ToolPath, float]:
        raise StrongCurrentError("the current of 0.90 m/s is too strong")

    monkeypatch.setattr(hull_placement.PathStanding, "__call__", stand)
    script = Script().run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN, WorkState.ABORT]
    assert script.end.abort is AbortCode.CURRENT
    assert all(np.array_equal(r.q, script.references[0].q) for r in script.references)


@pytest.mark.parametrize(
    "wrong", [{"finds": 0}, {"finds": True}, {"interval": -1.0}, {"interval": np.nan}]
)
def test_looks_that_cannot_be(wrong):
    with pytest.raises(ConfigurationError, match=next(iter(wrong))):
        ScanLimits(**wrong)


def test_giving_up_after_as_many_views_as_allowed():
    script = Script(looks=[False] * 10).run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN] * 3 + [WorkState.ABORT]
    places = [r.X_WB[:3, 3] for r in script.references if r.scan]
    assert np.linalg.norm(places[2] - places[1]) > 0.2  # not the same place again
    assert script.end.note == "not identified in 3 views: too few points"
    assert script.end.X_WG is None  # the arm stays folded


def test_a_camera_that_gives_nothing():
    script = Script(looks=()).run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN, WorkState.ABORT]
    assert script.end.note == "no depth frame arrived within 5 s"


WITHOUT_CONTACT = [state for state in JOURNEY if state is not WorkState.PRESS]


def test_work_without_contact_keeps_its_distance():
    script = Script(
        job=SurfaceTaskConfig(forces=(60.0,), contactless=0.03), felt=lambda _: 0.0
    ).run()
    assert script.states == [*WITHOUT_CONTACT, WorkState.DONE]
    work = script.of(WorkState.WORK)
    assert {round(float(tip(r)[2]), 9) for r in work} == {0.03}
    assert tip(work[-1])[0] == pytest.approx(0.12)
    assert not any(r.set_force or r.force_control for r in script.references)
    fastest = max(float(np.linalg.norm(r.v_WG_W)) for r in script.of(WorkState.APPROACH)[-20:])
    assert fastest <= script.job.approach.touch_speed + 0.01  # it comes to its distance slowly
    assert tip(script.end)[2] >= script.job.approach.standoff - 1e-3


def test_a_touch_on_the_way_ends_work_without_contact():
    def felt(reference: Reference) -> float:  # something 50 mm before the surface
        return (
            STIFFNESS * max(0.0, 0.05 - float(tip(reference)[2]))
            if reference.state is WorkState.APPROACH
            else 0.0
        )

    script = Script(job=SurfaceTaskConfig(forces=(60.0,), contactless=0.03), felt=felt).run()
    assert script.states == [*JOURNEY[:5], WorkState.RETREAT, WorkState.ABORT]
    assert "unexpected contact" in script.end.note


@pytest.mark.parametrize("axis", [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
def test_it_comes_in_along_the_axis_of_the_arms_base(axis):
    """Under the hull: from above; on its side: from the side.

    The arm unfolds before that, `lift` or more away.
    """
    script = Script()
    script.side = axis[1] > 0.0
    script.run()
    moves = script.of(WorkState.CLOSE_IN)
    unfolding = [r for r in moves if np.any(r.qd)]
    assert unfolding
    held = {tuple(np.round(r.X_WB[:3, 3], 6)) for r in unfolding}
    assert len(held) == 1
    back = np.array(held.pop()) - WORK_POSE[:3, 3]
    assert back @ -np.array(axis) >= script.job.arrival.lift - 1e-6
    assert np.linalg.norm(np.cross(back, axis)) < 1e-6
    last = moves[-1].X_WB[:3, 3]
    assert last == pytest.approx(WORK_POSE[:3, 3], abs=1e-6)


@pytest.mark.seeds(0, 1)
def test_wherever_it_is_to_stand_it_comes_to_stand_there_once(
    seed: int, monkeypatch: pytest.MonkeyPatch
):
    """Its place to the last bit: a hull that ended 1.6e-8 short, turned, unfolded its arm and moved
    on for ever.
    """
    rng = np.random.default_rng(seed)
    X_WB = pose(
        exp_so3([0.0, 0.0, rng.uniform(-3.1, 3.1)]), WORK_POSE[:3, 3] + rng.uniform(-0.2, 0.2, 3)
    )

    def place(vehicle: Vehicle, *_: Any, **__: Any) -> Placement:
        return Placement(
            X_WB=X_WB,
            travel_W=np.zeros(3),
            roll=0.0,
            q_start=vehicle.q_ready,
            margin=1.0,
            reached=1.0,
        )

    monkeypatch.setattr(hull_placement, "place_hull", place)
    script = Script().run(seconds=200.0)  # half a turn takes 113
    assert script.states == [*JOURNEY, WorkState.DONE]
    assert np.array_equal(script.of(WorkState.TARE)[0].X_WB, X_WB)
    turning = np.array([np.any(r.qd) for r in script.of(WorkState.CLOSE_IN)])
    assert np.count_nonzero(np.diff(turning.astype(int)) == 1) == 1


def test_a_tool_stays_off_the_object_while_the_hull_rises_on_what_thrusters_are_left():
    """Drawn up in W beside the hull's way, and folded once the hull has come up; a tilted hull does
    not swing it in.
    """
    script = Script(dead=3, fastest=0.05).run()  # a hull that comes less far than it is asked to
    assert script.states == [*JOURNEY, WorkState.ABORT]
    back = [r for r in script.of(WorkState.RETREAT) if r.X_WG is not None]
    rising = [r for r in back if np.any(r.v_WB_W)]
    assert all(r.lost_thrusters == (3,) for r in back)
    assert len(rising) > 100
    away = np.array([tip(r)[2] for r in back])  # the surface is at 0, the tool looks down
    assert np.diff(away).min() >= 0.0
    limits = script.job.escape
    standoff = script.job.approach.standoff
    assert away[0] >= standoff
    assert away[-1] == pytest.approx(standoff + limits.draw + limits.free, abs=0.01)
    turns = np.array(
        [
            np.abs(np.asarray(r.X_WG)[:3, :3] - np.asarray(rising[0].X_WG)[:3, :3]).max()
            for r in rising
        ]
    )
    assert turns.max() == 0.0
    assert script.end.X_WG is None
    assert script.end.q == pytest.approx(script.references[0].q)  # folded as at the start


def test_a_hull_that_cannot_ascend_is_given_up_with_the_tool_off_the_surface():
    script = Script(dead=3, fastest_after=0.0).run()
    assert script.states == [*JOURNEY, WorkState.ABORT]
    back = script.of(WorkState.RETREAT)
    assert back[-1].time - back[0].time == pytest.approx(script.job.escape.patience, abs=0.1)
    assert tip(back[-1])[2] == pytest.approx(
        script.job.approach.standoff + script.job.escape.draw, abs=0.01
    )
    assert script.end.X_WG is None


def test_a_thruster_that_is_lost_on_the_way_back_makes_the_vehicle_leave_at_once():
    script = Script(dead=3, dead_from=lambda reference: reference.state is WorkState.RETREAT).run()
    assert script.states == [*JOURNEY, WorkState.ABORT]
    assert script.end.abort is AbortCode.THRUSTER
    back = script.of(WorkState.RETREAT)
    assert not any(r.force_control for r in back[3:])  # it does not release the force slowly first
    assert script.end.q == pytest.approx(script.references[0].q)


def test_a_tool_that_is_pressed_on_the_way_back_makes_the_vehicle_leave_at_once():
    def caught(reference: Reference) -> float:
        drawn_off = (
            reference.state is WorkState.RETREAT
            and not reference.force_control
            and reference.abort is None
        )
        return 140.0 if drawn_off else obedient(reference)

    script = Script(felt=caught).run()
    assert script.states == [*JOURNEY, WorkState.ABORT]
    assert script.end.abort is AbortCode.FORCE_LIMIT
    assert "140 N" in script.end.note
    assert (
        Script(felt=lambda r: 100.0 if caught(r) > 100.0 else caught(r)).run().end.state
        is WorkState.DONE
    )


def test_friction_across_the_tool_does_not_count_until_it_is_released():
    """Forces of 90 N with friction 0.9 are 121 N in all, above the limit of 118 N: the job ends as
    any other.
    """
    job = SurfaceTaskConfig(forces=(90.0,))
    assert Script(job=job, friction=0.9).run().end.state is WorkState.DONE

    def caught(reference: Reference) -> float:
        back = (
            reference.state is WorkState.RETREAT
            and not reference.force_control
            and reference.abort is None
        )
        return 60.0 if back else obedient(reference)

    # 134 N in all, 60 N along the axis
    caught_aside = Script(job=job, felt=caught, friction=2.0).run()
    assert caught_aside.end.abort is AbortCode.FORCE_LIMIT


def test_path_out_of_reach(monkeypatch):
    def place(*_: Any, **__: Any) -> Placement:
        raise ReachError("out of reach: at best 40%")

    monkeypatch.setattr(hull_placement, "place_hull", place)
    script = Script().run()
    assert script.states == [WorkState.SETTLE, WorkState.SCAN, WorkState.ABORT]
    assert script.end.note == "out of reach: at best 40%"


def test_the_middle_is_worked_where_the_reach_ends_sooner(monkeypatch):
    reached = hull_placement.place_hull

    def place(vehicle: Vehicle, chain: Chain, path: ToolPath, **options: Any) -> Placement:
        if path.s[-1] > 0.105:
            raise ReachError("out of reach")
        return reached(vehicle, chain, path, **options)

    monkeypatch.setattr(hull_placement, "place_hull", place)
    script = Script(job=SurfaceTaskConfig(forces=(60.0,), least=0.8)).run()
    assert script.end.state is WorkState.DONE
    assert 0.095 < script.end.path_s < 0.105
    assert "of the path" in script.end.note


def test_hull_is_waited_for_on_its_way():
    """One that makes 5 cm/s where 25 are asked for, against a current: it arrives, and its
    reference stays near it.
    """
    slow = Script(fastest=0.05).run()
    free = Script().run()
    assert slow.states == free.states == [*JOURNEY, WorkState.DONE]
    longer = len(slow.of(WorkState.CLOSE_IN)) - len(free.of(WorkState.CLOSE_IN))
    assert 3.0 < longer * PERIOD < 30.0  # measured 23: the way leads clear of the object


def test_hull_that_does_not_come_along_is_given_up():
    stuck = Script(fastest=0.0).run(150.0)
    assert stuck.states == [*JOURNEY[:3], WorkState.ABORT]
    assert stuck.end.abort is AbortCode.HULL_LATE
    assert "behind its trajectory" in stuck.end.note
    assert stuck.end.X_WG is None  # the arm stays as it is, and so does the hull
    assert not stuck.end.v_WB_W.any()


def test_hull_does_not_move_before_it_is_quiet(monkeypatch):
    """A hull that never comes to rest is not scanned from."""
    monkeypatch.setattr(Settle, "step", lambda *_: None)
    assert Script().run(seconds=30.0).states == [WorkState.SETTLE]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"forces": ()}, "at least one set force"),
        ({"forces": (60.0, -60.0)}, "task.forces .*positive.*got -60"),
        ({"forces": (float("nan"),)}, "task.forces .*finite"),
        ({"forces": (160.0,)}, "no room for overshoot"),
        ({"forces": (60.0, 2.9)}, "2.9 N cannot be distinguished from no contact: at least 3 N"),
        ({"forces": (60.0,), "contactless": 0.0}, r"task\.contactless \[m\]"),
        ({"forces": (60.0,), "contactless": 0.2}, "at most the stand-off of 0.1 m, got 0.2"),
        ({"forces": (60.0,), "speed": 0.0}, "task.speed"),
    ],
)
def test_jobs_that_cannot_be(options, said):
    with pytest.raises(ConfigurationError, match=said):
        SurfaceTaskConfig(**options)


def test_a_hollow_is_passed_at_the_stand_off(within):
    """Lifted before it, pressed again behind it; no stretch is left out, and the path is worked to
    its end.
    """
    script = Script(hollow=(0.05, 0.07), period=0.02).run()
    again = [
        WorkState.CLOSE_IN,
        WorkState.APPROACH,
        WorkState.PRESS,
        WorkState.WORK,
        WorkState.RETREAT,
    ]
    assert script.states == [*JOURNEY, *again, WorkState.DONE]
    worked = np.array([reference.path_s for reference in script.of(WorkState.WORK)])
    assert not np.any((worked > 0.05) & (worked < 0.07))
    within("begin and end [m]", [worked.min(), worked.max() - 0.12], 1e-3)
    moved = [
        tip(reference)
        for reference in script.of(WorkState.CLOSE_IN)
        if 0.051 < reference.path_s < 0.069
    ]
    assert len(moved) > 50
    standoff = script.job.approach.standoff
    within("height of the tool [m]", min(p_tool[2] for p_tool in moved) - standoff, 1e-9)
    assert "a hollow" in {reference.note for reference in script.references}


def test_a_fault_between_two_stretches_ends_the_work():
    script = Script(hollow=(0.05, 0.07), dead=0).run()
    assert script.end.state is WorkState.ABORT
    assert script.end.abort is not AbortCode.NO_CONTACT
    assert max(reference.path_s for reference in script.of(WorkState.WORK)) <= 0.05
