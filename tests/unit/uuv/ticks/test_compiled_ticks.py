"""Compiled ticks of the loop: the same bits as part by part, what they leave to the parts, and
several at a time.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv import Scenario, assemble, jobs
from uuv.assembly import Assembly
from uuv.controllers.arm.kernel_force_law import KernelForceLaw
from uuv.controllers.arm.position_force import INTEGRAL, ForceDisplacement
from uuv.controllers.planning.promise import PromiseLimits, StopLimits
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.tasks.task import TaskPlanner
from uuv.controllers.tuning import FaultLimits
from uuv.controllers.whole_body.tool_control import ForceLaw
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.jobs import clean_object, clean_pile, insert_sampler, inspect_object, sample_seabed
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.perturbations.loop import SensorFailure, ThrusterFailure
from uuv.perturbations.pad import Pad
from uuv.perturbations.target import MovingObject
from uuv.perturbations.vehicle import Water
from uuv.perturbations.wake import Wake
from uuv.runner import run_through
from uuv.scenario import LONGEST, Control
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import EncoderMeasurement, FaultKind
from uuv.sim.loop import recording
from uuv.sim.loop.logged_columns import EVERY_STEP
from uuv.sim.sensors.proprioception import Dvl, Imu
from uuv.tasks.surface_work import SurfaceWorkTask
from uuv.ticks.compiled_ticks import reason
from uuv.ticks.planner_ahead import PlannerAhead

EARLY = 4.0  # [s] of a short run: settled, and identified


def digests(
    scenario: Scenario,
    longest: float,
    change: Callable[[Assembly], Assembly] = lambda a: a,
    *,
    full: bool = True,
) -> list[str]:
    """Digest of all series of a run, part by part and with compiled ticks; the second must have
    compiled some.

    A `full` recording takes each tick of its slower rows apart, and with that each step of the
    hull.
    """
    digests_of = []
    for part_by_part in (True, False):
        run = run_through(
            change(assemble(scenario, full=full)), longest=longest, part_by_part=part_by_part
        )
        assert bool(run.part_by_part) == part_by_part
        digests_of.append(run.recording.digest(run.recording.series))
    return digests_of


@pytest.mark.parametrize("full", [True, False])
def test_a_run_with_gusts_has_the_same_bits(full):
    compiled, other = digests(jobs.clean_barrel(quick=True, gust=0.05), EARLY, full=full)
    assert compiled == other


def test_foreseen_periods_need_no_step_of_the_planner_and_end_at_a_bound(monkeypatch):
    """At rest in gusts, whose speed passes the bound now and then; the bits are as part by part."""
    tables: list[tuple[int, int]] = []  # rows taken, and rows
    steps = [0]
    close, step = PlannerAhead.close, TaskPlanner.step

    def closed(ahead: PlannerAhead) -> Any:
        rows = ahead.table.record.rows.tolist()
        tables.extend([(rows[0], rows[1])] if rows[1] else [])
        return close(ahead)

    def stepped(*values: Any) -> Any:
        steps[0] += 1
        return step(*values)

    monkeypatch.setattr(PlannerAhead, "close", closed)
    monkeypatch.setattr(TaskPlanner, "step", stepped)
    scenario = jobs.clean_barrel(quick=True, gust=0.03)
    one, other = digests(scenario, EARLY, full=False)
    assert one == other

    periods = round(EARLY / 0.01)
    assert steps[0] < 1.6 * periods  # both runs together
    assert sum(taken for taken, _ in tables) == 2 * periods - steps[0]
    assert any(taken == rows for taken, rows in tables)
    assert any(0 < taken < rows for taken, rows in tables)


def test_a_recording_that_outgrows_its_table_has_the_same_bits(monkeypatch):
    """The table of rows grows in ticks of either kind."""
    monkeypatch.setattr(recording, "_ROWS", 61)
    compiled, other = digests(jobs.clean_barrel(quick=True), 0.6)
    assert compiled == other


@pytest.mark.parametrize(
    ("perturbation", "slow"),
    [
        (ThrusterFailure(thruster="sway", share=0.3, at=0.4), "FaultyPlant"),
        (ThrusterFailure(thruster="sway", stuck=True, at=0.4), "FaultyPlant"),
        (MovingObject(amplitude=(0.0, 0.02, 0.0), frequency=0.5), "MovedObjectPlant"),
        (Wake(), "CylinderWake"),
    ],
    ids=["weak thruster", "stuck thruster", "swinging object", "wake"],
)
def test_a_plant_with_parts_in_python_has_the_same_bits(perturbation, slow):
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=(perturbation,))
    compiled, other = digests(scenario, 1.5)
    assert compiled == other
    assert run_through(assemble(scenario), longest=0.05).slow_parts == (slow,)


@pytest.mark.parametrize(
    "failures",
    [
        [SensorFailure(sensor="encoders", effect="lost", at=0.4)],
        [SensorFailure(sensor="imu", effect="lost", at=0.4)],
        [
            SensorFailure(sensor="torque", effect="frozen", field="tau", index=2, at=0.3),
            SensorFailure(sensor="torque", effect="offset", field="tau", value=2.0, at=0.2),
            SensorFailure(sensor="encoders", effect="frozen", field="qd", index=1, at=0.4),
            SensorFailure(sensor="imu", effect="turned", index=2, value=0.01, rate=0.1, at=0.5),
        ],
    ],
    ids=["no encoders", "no imu", "all three, one twice"],
)
def test_a_run_with_faulty_sensors_of_every_tick_has_the_same_bits(failures):
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=tuple(failures))
    compiled, other = digests(scenario, 0.9)
    assert compiled == other != sound_digest()
    slow = run_through(assemble(scenario), longest=0.05).slow_parts
    assert slow == ("FaultySensor",) * len({failure.sensor for failure in failures})


@cache
def sound_digest() -> str:
    """Digest of the first 0.9 s without a failure."""
    built = assemble(jobs.clean_barrel(quick=True), full=True)
    recorded = run_through(built, longest=0.9).recording
    return recorded.digest(recorded.series)


class OwnImu:
    """An inertial unit of one's own, without a record, that measures as the usual one."""

    period, delay = 0.002, 0.0

    def __init__(self, sends: Callable[[Any], Any] = lambda measurement: measurement) -> None:
        self._usual = Imu()
        self._sends = sends

    def channel(self) -> str:
        """Of the inertial unit."""
        return "imu"

    def init(self, rng: np.random.Generator) -> list[Any]:
        """Its state."""
        return [self._usual.init(rng)]

    def step(self, state: list[Any], truth: Any) -> tuple[list[Any], Any]:
        """What it sends."""
        state[0], measurement = self._usual.step(state[0], truth)
        return state, self._sends(measurement)


def with_imu(built: Assembly, imu: Any) -> Assembly:
    sensors = [imu if isinstance(sensor, Imu) else sensor for sensor in built.parts.sensors]
    return replace(built, loop=replace(built.loop, parts=replace(built.parts, sensors=sensors)))


def test_a_sensor_of_ones_own_of_every_tick_has_the_bits_of_the_usual_one():
    scenario = jobs.clean_barrel(quick=True)
    compiled, other = digests(scenario, 0.9, lambda built: with_imu(built, OwnImu()))
    assert compiled == other == sound_digest()


def test_a_sensor_that_sends_what_its_channel_does_not_take_is_named():
    sent: list[float] = []

    def later_another(m: Any) -> Any:
        sent.append(m.time)
        return (
            m if m.time < 0.301 else EncoderMeasurement(time=m.time, q=np.zeros(6), qd=np.zeros(6))
        )

    built = with_imu(assemble(jobs.clean_barrel(quick=True)), OwnImu(later_another))
    with pytest.raises(ConfigurationError, match="'imu': must send ImuMeasurement, got Encoder"):
        run_through(built, longest=0.5)
    assert max(sent) == pytest.approx(0.302)


def test_lost_vision_is_found_at_the_same_tick():
    """Vision falls silent; its age passes the limit between two slow ticks, and the fault ends the
    compiled ones.
    """
    silent = SensorFailure(sensor="vision", effect="lost", at=1.0)
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=(silent,))
    digests_of = []
    for part_by_part in (True, False):
        run = run_through(assemble(scenario, full=True), longest=EARLY, part_by_part=part_by_part)
        assert bool(run.part_by_part) == part_by_part
        assert FaultKind.VISION in {fault.kind for fault in run.last.command.faults}
        digests_of.append(run.recording.digest(run.recording.series))
    assert digests_of[0] == digests_of[1]


def test_a_gyro_that_is_off_is_found_at_the_same_tick(monkeypatch):
    """Its bias is in the record of a sensor of the usual kind, so that its ticks are compiled."""
    init = Imu.init

    def off(self: Imu, rng: np.random.Generator) -> Any:
        state = init(self, rng)
        state.bias[8] += 0.01  # [rad/s] about z
        return state

    monkeypatch.setattr(Imu, "init", off)
    digests_of = []
    for part_by_part in (True, False):
        run = run_through(
            assemble(jobs.clean_barrel(quick=True), full=True),
            longest=1.0,
            part_by_part=part_by_part,
        )
        assert bool(run.part_by_part) == part_by_part
        assert (FaultKind.GYRO, 2) in {
            (fault.kind, fault.index) for fault in run.last.command.faults
        }
        digests_of.append(run.recording.digest(run.recording.series))
    assert digests_of[0] == digests_of[1]


def test_a_fix_between_two_ticks_of_the_planner_is_taken_at_its_own_tick():
    """The Doppler log measures every 3 ticks, the planner comes every 5: after a fix of vision, a
    log is due within.
    """

    def often(assembly: Assembly) -> Assembly:
        sensors = [
            replace(s, period=0.006) if isinstance(s, Dvl) else s for s in assembly.parts.sensors
        ]
        return replace(
            assembly, loop=replace(assembly.loop, parts=replace(assembly.parts, sensors=sensors))
        )

    compiled, other = digests(jobs.clean_barrel(quick=True), 1.5, often)
    assert compiled == other


def test_doubtful_residuals_are_looked_at_in_every_tick():
    """Bounds so narrow that sound sensors pass them all the time, and a confirmation that makes no
    fault of it.
    """
    limits = FaultLimits(
        torque_floor=1e-6, friction=1e-6, torque_share=1e-9, torque_confirm=1e3, warm_up=0.5
    )

    def narrow(assembly: Assembly) -> Assembly:
        wrapper = assembly.parts.controller
        assert isinstance(wrapper, SafetyWrapper)
        wrapper = SafetyWrapper(wrapper.controller, assembly.plant.model, limits=limits)
        return replace(
            assembly, loop=replace(assembly.loop, parts=replace(assembly.parts, controller=wrapper))
        )

    compiled, other = digests(jobs.clean_barrel(quick=True), 1.5, narrow)
    assert compiled == other


def stopping() -> Scenario:
    """A tool that stops whatever is promised."""
    plain = jobs.clean_barrel(quick=True, gust=0.05, seed=3)
    assert isinstance(plain.task, SurfaceWorkTask)
    return replace(
        plain,
        task=replace(plain.task, promise=PromiseLimits(stops=StopLimits(every=1.0, below=1.0))),
    )


def bare(assembly: Assembly) -> Assembly:
    """Without the safety wrapper."""
    parts = replace(assembly.parts, controller=untyped(assembly.parts.controller).controller)
    return replace(assembly, loop=replace(assembly.loop, parts=parts))


@pytest.mark.long
def test_a_tool_that_stops_tells_navigation_at_the_same_ticks_in_every_way():
    """Part by part, and compiled without a safety wrapper; that it stops shows in the time it
    takes.
    """
    compiled, other = digests(stopping(), LONGEST, bare)
    assert compiled == other
    usual = run_through(
        bare(assemble(jobs.clean_barrel(quick=True, gust=0.05, seed=3)))
    ).recording.duration
    assert run_through(bare(assemble(stopping()))).recording.duration > usual + 4.0


@pytest.mark.long
@pytest.mark.parametrize(
    "scenario",
    [
        jobs.clean_barrel(quick=True, gust=0.05, seed=3),
        jobs.clean_barrel(quick=True, path="longitudinal", current=(0.3, 0.1, 0.0)),
        jobs.clean_barrel(quick=True, arm_errors=3, calibrated=True),
        jobs.clean_barrel(quick=True, vehicle="uuv_puma_side"),
        replace(
            jobs.clean_barrel(quick=True), perturbations=(Water(spread=0.3), Pad(stiffness=2e5))
        ),
        stopping(),
        clean_pile(quick=True),
        clean_object(),
        insert_sampler(),
        inspect_object(),
        sample_seabed(work="core"),
    ],
    ids=[
        "gusts",
        "longitudinal",
        "calibrated",
        "side arm",
        "stiff pad",
        "stops",
        "pile",
        "object",
        "insertion",
        "inspection",
        "core",
    ],
)
def test_whole_runs_have_the_same_bits(scenario):
    digests_of = []
    for part_by_part in (True, False):
        run = run_through(assemble(scenario, full=True), part_by_part=part_by_part)
        digests_of.append(run.recording.digest(run.recording.series))
    assert digests_of[0] == digests_of[1]


def integrate(memory, set_force, felt, _servo_compliance, dt):
    """Displacement [m] by an integrator of fixed gain."""
    memory[0] += 1e-4 * (set_force - felt) * dt
    return memory[0]


def with_force_law(law: ForceLaw) -> Callable[[Assembly], Assembly]:
    def change(assembly: Assembly) -> Assembly:
        model = assembly.plant.model
        controller = SafetyWrapper(WorkController(model, force_law=law), model)
        return replace(
            assembly,
            loop=replace(assembly.loop, parts=replace(assembly.parts, controller=controller)),
        )

    return change


@pytest.mark.long
def test_a_force_law_of_ones_own_has_the_same_bits():
    """It runs compiled, and differs from the default one."""
    law = KernelForceLaw(law=integrate)
    compiled, other = digests(
        jobs.clean_barrel(quick=True), LONGEST, with_force_law(law), full=False
    )
    usual = run_through(
        with_force_law(ForceDisplacement())(assemble(jobs.clean_barrel(quick=True)))
    ).recording
    assert compiled == other
    assert compiled != usual.digest(usual.series)


class Integrator(ForceDisplacement):
    """The same law in plain Python."""

    def step(self, state, set_force, felt, servo_compliance, dt):
        k = state.k + 1e-4 * (set_force - felt) * dt
        most = self.speed * dt
        state.k = min(max(min(max(k, state.k - most), state.k + most), -self.limit), self.limit)
        return state.k


class Failing(ForceDisplacement):
    """A law that fails when its loop has been open for so many steps."""

    def release(self, state, dt, *, inwards=True):
        state.numbers[INTEGRAL] += 1.0
        if state.numbers[INTEGRAL] > 30.0:
            raise ZeroDivisionError("the law's own")
        return 0.0


def test_parts_in_python_are_named_and_parts_with_kernels_are_not():
    def slow(control: Control | None = None, law: ForceLaw | None = None) -> tuple[str, ...]:
        scenario = jobs.clean_barrel(quick=True)
        built = assemble(scenario if control is None else replace(scenario, control=control))
        return run_through(
            built if law is None else with_force_law(law)(built), longest=0.05
        ).slow_parts

    assert slow() == slow(ABLATED) == slow(law=KernelForceLaw(law=integrate)) == ()
    assert slow(law=Integrator()) == ("Integrator",)
    assert slow(PUBLISHED) == ("ClosedFormForce", "PublishedForceLaw", "TangentialForceLoop")
    assert slow(JOINT_PD) == ("JointForceController",)


@pytest.mark.parametrize("part_by_part", [True, False])
def test_what_a_part_in_python_raises_comes_out_as_it_is(part_by_part):
    built = with_force_law(Failing())(assemble(jobs.clean_barrel(quick=True)))
    with pytest.raises(ZeroDivisionError, match="the law's own") as raised:
        run_through(built, longest=1.0, part_by_part=part_by_part)
    assert raised.traceback[-1].name == "release"
    assert 0.1 < built.plant.truth.time < 0.2


class EveryTick:
    """Observer that keeps number, time, depth, estimate and torque of every tick."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []

    def observe(self, moment):
        truth, estimate = moment.truth, moment.estimate
        torque = moment.command.joint_torque
        self.rows.append(
            (moment.tick, truth.time, truth.p_pad[2], estimate.time, estimate.X_WB[0, 3], torque[1])
        )


def test_what_has_no_kernel_is_named():
    built = assemble(jobs.clean_barrel(quick=True))
    plant = built.loop.plant
    parts = built.parts
    assert reason(plant, parts) == ""
    for ik in ("jacobian_free", "plain"):
        other = assemble(jobs.clean_barrel(quick=True, ik=ik)).loop
        assert reason(other.plant, other.parts) == ""
    assert "0 sensors that sample encoders" in reason(
        plant, replace(parts, sensors=parts.sensors[1:])
    )
    loop = assemble(jobs.clean_barrel(quick=True, without=("fusion",))).loop
    assert "RawNavigation" in reason(loop.plant, loop.parts)


class Wrapped:
    """A plant wrapper of one's own, without a record."""

    def __init__(self, plant):
        self.plant = plant
        self.timestep = plant.timestep

    def observe(self):
        return self.plant.observe()

    def step(self, command):
        self.plant.step(command)


def test_a_wrapper_of_ones_own_below_one_with_a_kernel_is_named():
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=(MovingObject(),))
    loop = assemble(scenario).loop
    assert reason(loop.plant, loop.parts) == ""
    moved = untyped(loop.plant)
    moved.plant = Wrapped(moved.plant)
    assert reason(moved, loop.parts) == "plant Wrapped"


class Deaf(Navigation):
    """Estimator with a step of its own, which its kernel does not know."""

    def step(self, state, measurements):
        return super().step(state, measurements)


class Quiet(Imu):
    """Sensor with a field of its own, but the step of its kernel."""


def test_a_part_that_overrides_a_method_has_no_kernel_until_it_gives_one():
    built = assemble(jobs.clean_barrel(quick=True))
    plant = built.loop.plant
    parts = built.parts
    assert reason(plant, replace(parts, estimator=Deaf())) == "estimator Deaf"
    sensors = [Quiet() if isinstance(sensor, Imu) else sensor for sensor in parts.sensors]
    assert reason(plant, replace(parts, sensors=sensors)) == ""


JOINT_PD = Control(
    controller="uuv.controllers.whole_body.joint_force_controller:JointForceController"
)


ABLATED = Control(without=("force-control", "drift-correction"))
PUBLISHED = Control(published=("force-law", "tip-force"))
GUARD = (
    "tests/unit/uuv/ticks/test_compiled_ticks.py"
    "::test_a_run_with_other_parts_of_the_controller_has_the_same_bits"
)


@pytest.mark.parametrize(
    ("control", "full"),
    [
        pytest.param(ABLATED, False, id="ablated"),
        pytest.param(PUBLISHED, False, id="published"),
        pytest.param(JOINT_PD, True, id="own-full"),
        pytest.param(ABLATED, True, marks=pytest.mark.long(guarded_by=GUARD), id="ablated-full"),
        pytest.param(JOINT_PD, False, marks=pytest.mark.long(guarded_by=GUARD), id="own"),
    ],
)
def test_a_run_with_other_parts_of_the_controller_has_the_same_bits(control, full):
    compiled, other = digests(
        replace(jobs.clean_barrel(quick=True, gust=0.05), control=control), EARLY, full=full
    )
    assert compiled == other


@pytest.mark.long
@pytest.mark.parametrize(
    "control", [Control(without=("drift-correction",)), JOINT_PD], ids=["ablated", "own"]
)
def test_whole_runs_around_a_controller_have_the_same_bits(control):
    compiled, other = digests(
        replace(jobs.clean_barrel(quick=True, gust=0.05), control=control), LONGEST, full=False
    )
    assert compiled == other


class Wrong:
    """Controller that after a second commands what it is made with."""

    def __init__(self, inner: Any, **change: Any) -> None:
        self.inner = inner
        self.period = inner.period
        self.change = change

    def init(self, estimate):
        return self.inner.init(estimate)

    def step(self, state, estimate, reference):
        state, command = self.inner.step(state, estimate, reference)
        return state, replace(command, **self.change) if estimate.time > 1.0 else command


@pytest.mark.parametrize(
    "change", [{"joint_torque": np.zeros(5)}, {"thrusters": np.full(6, np.nan)}]
)
def test_a_command_that_is_none_is_refused_as_part_by_part(change):
    messages = []
    for part_by_part in (True, False):
        built = assemble(jobs.clean_barrel(quick=True))
        controller = Wrong(untyped(built.parts.controller).controller, **change)
        loop = replace(built.loop, parts=replace(built.parts, controller=controller))
        with pytest.raises(ConfigurationError) as refused:
            run_through(replace(built, loop=loop), longest=2.0, part_by_part=part_by_part)
        messages.append(str(refused.value))
    assert messages[0] == messages[1]


def test_an_observer_of_every_tick_sees_every_tick_as_part_by_part():
    tables = []
    for part_by_part in (True, False):
        watching = EveryTick()
        built = assemble(jobs.clean_barrel(quick=True, gust=0.05))
        run = run_through(built, observers=[watching], longest=0.2, part_by_part=part_by_part)
        tables.append(np.array(watching.rows))
        assert run.slow_parts == (() if part_by_part else ("EveryTick",))
    assert np.array_equal(tables[0], tables[1])
    assert tables[0][:, 0].tolist() == list(range(100))


def test_runs_in_threads_have_the_bits_of_runs_in_turn():
    def digest(seed: int) -> str:
        return run_through(
            assemble(jobs.clean_barrel(quick=True, seed=seed)), longest=1.0
        ).recording.digest(EVERY_STEP)

    in_turn = [digest(seed) for seed in (0, 1)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(digest, (0, 1))) == in_turn
