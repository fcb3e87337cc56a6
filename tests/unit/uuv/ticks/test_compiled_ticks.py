"""Compiled ticks of the loop: the same bits as part by part, what they leave to the parts, and several at a time."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv import Scenario, assemble, jobs
from uuv.assembly import Assembly
from uuv.controllers.arm.kernel_force_law import KernelForceLaw
from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.controllers.planning.promise import PromiseLimits, StopLimits
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.tuning import FaultLimits
from uuv.controllers.whole_body.tool_control import ForceLaw
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.jobs import clean_object, clean_pile, insert_sampler, inspect_object, sample_seabed
from uuv.perturbations.loop import SensorFailure, ThrusterFailure
from uuv.perturbations.pad import Pad
from uuv.perturbations.vehicle import Water
from uuv.runner import run_through
from uuv.scenario import LONGEST, Control
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind
from uuv.sim.loop import recording
from uuv.sim.loop.logged_columns import EVERY_STEP
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Parts
from uuv.sim.sensors.proprioception import Dvl, Imu
from uuv.tasks.surface_work import SurfaceWorkTask
from uuv.ticks.compiled_ticks import CompiledTicks, reason
from uuv.ticks.ticks_around import TicksAround, ticks_for

EARLY = 4.0  # [s] of a short run: settled, and identified


def digests(
    scenario: Scenario, longest: float, change: Callable[[Assembly], Assembly] = lambda a: a, *, full: bool = True
) -> list[str]:
    """Digest of all series of a run, part by part and with compiled ticks; the second must have compiled some.

    A `full` recording takes each tick of its slower rows apart, and with that each step of the hull.
    """
    found = []
    for part_by_part in (True, False):
        result = run_through(change(assemble(scenario, full=full)), longest=longest, part_by_part=part_by_part)
        assert bool(result.part_by_part) == part_by_part
        found.append(result.recording.digest(result.recording.series))
    return found


@pytest.mark.parametrize("full", [True, False])
def test_a_run_with_gusts_has_the_same_bits(full):
    one, other = digests(jobs.clean_barrel(quick=True, gust=0.05), EARLY, full=full)
    assert one == other


def test_a_recording_that_outgrows_its_table_has_the_same_bits(monkeypatch):
    """The table of rows grows in ticks of either kind."""
    monkeypatch.setattr(recording, "_ROWS", 61)
    one, other = digests(jobs.clean_barrel(quick=True), 0.6)
    assert one == other


def test_lost_vision_is_found_at_the_same_tick():
    """Vision falls silent; its age passes the limit between two slow ticks, and the fault ends the compiled ones."""
    silent = SensorFailure(sensor="vision", effect="lost", at=1.0)
    scenario, found = replace(jobs.clean_barrel(quick=True), perturbations=(silent,)), []
    for part_by_part in (True, False):
        result = run_through(assemble(scenario, full=True), longest=EARLY, part_by_part=part_by_part)
        assert bool(result.part_by_part) == part_by_part
        assert FaultKind.VISION in {fault.kind for fault in result.last.command.faults}
        found.append(result.recording.digest(result.recording.series))
    assert found[0] == found[1]


def test_a_gyro_that_is_off_is_found_at_the_same_tick(monkeypatch):
    """Its bias is in the record of a sensor of the usual kind, so that its ticks are compiled."""
    init = Imu.init

    def off(self: Imu, rng: np.random.Generator) -> Any:
        state = init(self, rng)
        state.bias[8] += 0.01  # [rad/s] about z
        return state

    monkeypatch.setattr(Imu, "init", off)
    found = []
    for part_by_part in (True, False):
        result = run_through(assemble(jobs.clean_barrel(quick=True), full=True), longest=1.0, part_by_part=part_by_part)
        assert bool(result.part_by_part) == part_by_part
        assert (FaultKind.GYRO, 2) in {(fault.kind, fault.index) for fault in result.last.command.faults}
        found.append(result.recording.digest(result.recording.series))
    assert found[0] == found[1]


def test_a_fix_between_two_ticks_of_the_planner_is_taken_at_its_own_tick():
    """The Doppler log measures every 3 ticks, the planner comes every 5: after a fix of vision, a log is due within."""

    def often(assembly: Assembly) -> Assembly:
        sensors = [replace(s, period=0.006) if isinstance(s, Dvl) else s for s in assembly.parts.sensors]
        return replace(assembly, loop=replace(assembly.loop, parts=replace(assembly.parts, sensors=sensors)))

    one, other = digests(jobs.clean_barrel(quick=True), 1.5, often)
    assert one == other


def test_doubtful_residuals_are_looked_at_in_every_tick():
    """Bounds so narrow that sound sensors pass them all the time, and a confirmation that makes no fault of it."""
    limits = FaultLimits(torque_floor=1e-6, friction=1e-6, torque_share=1e-9, torque_confirm=1e3, warm_up=0.5)

    def narrow(assembly: Assembly) -> Assembly:
        wrapper = assembly.parts.controller
        assert isinstance(wrapper, SafetyWrapper)
        wrapper = SafetyWrapper(wrapper.controller, assembly.plant.model, limits=limits)
        return replace(assembly, loop=replace(assembly.loop, parts=replace(assembly.parts, controller=wrapper)))

    one, other = digests(jobs.clean_barrel(quick=True), 1.5, narrow)
    assert one == other


def stopping() -> Scenario:
    """A tool that stops whatever is promised."""
    plain = jobs.clean_barrel(quick=True, gust=0.05, seed=3)
    assert isinstance(plain.task, SurfaceWorkTask)
    return replace(plain, task=replace(plain.task, promise=PromiseLimits(stops=StopLimits(every=1.0, below=1.0))))


def bare(assembly: Assembly) -> Assembly:
    """Without the safety wrapper: the controller's ticks are not compiled, but those around it."""
    parts = replace(assembly.parts, controller=untyped(assembly.parts.controller).controller)
    return replace(assembly, loop=replace(assembly.loop, parts=parts))


@pytest.mark.long
def test_a_tool_that_stops_tells_navigation_at_the_same_ticks_in_every_way():
    """Part by part, and compiled around a controller without a kernel; that it stops shows in the time it takes."""
    one, other = digests(stopping(), LONGEST, bare)
    assert one == other
    usual = run_through(bare(assemble(jobs.clean_barrel(quick=True, gust=0.05, seed=3)))).recording.duration
    assert run_through(bare(assemble(stopping()))).recording.duration > usual + 4.0


@pytest.mark.long
@pytest.mark.parametrize(
    "scenario",
    [
        jobs.clean_barrel(quick=True, gust=0.05, seed=3),
        jobs.clean_barrel(quick=True, path="longitudinal", current=(0.3, 0.1, 0.0)),
        jobs.clean_barrel(quick=True, arm_errors=3, calibrated=True),
        jobs.clean_barrel(quick=True, vehicle="uuv_puma_side"),
        replace(jobs.clean_barrel(quick=True), perturbations=(Water(spread=0.3), Pad(stiffness=2e5))),
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
    found = []
    for part_by_part in (True, False):
        result = run_through(assemble(scenario, full=True), part_by_part=part_by_part)
        found.append(result.recording.digest(result.recording.series))
    assert found[0] == found[1]


def integrate(memory, set_force, felt, _servo_compliance, dt):
    """Displacement [m] by an integrator of fixed gain."""
    memory[0] += 1e-4 * (set_force - felt) * dt
    return memory[0]


def with_force_law(law: ForceLaw) -> Callable[[Assembly], Assembly]:
    def change(assembly: Assembly) -> Assembly:
        model = assembly.plant.model
        controller = SafetyWrapper(WorkController(model, force_law=law), model)
        return replace(assembly, loop=replace(assembly.loop, parts=replace(assembly.parts, controller=controller)))

    return change


@pytest.mark.long
def test_a_force_law_of_ones_own_has_the_same_bits():
    """It runs compiled, and differs from the default one."""
    law = KernelForceLaw(law=integrate)
    one, other = digests(jobs.clean_barrel(quick=True), LONGEST, with_force_law(law), full=False)
    usual = run_through(with_force_law(ForceDisplacement())(assemble(jobs.clean_barrel(quick=True)))).recording
    assert one == other
    assert one != usual.digest(usual.series)


class EveryTick:
    """Observer that counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def observe(self, moment):
        self.calls += 1


def test_what_has_no_kernel_is_named():
    built = assemble(jobs.clean_barrel(quick=True))
    plant, parts = built.loop.plant, built.parts
    assert reason(plant, parts, ()) == ""
    for ik in ("jacobian_free", "plain"):
        other = assemble(jobs.clean_barrel(quick=True, ik=ik)).loop
        assert reason(other.plant, other.parts, ()) == ""
    assert reason(plant, parts, (EveryTick(),)) == "observer EveryTick"
    assert "Encoders" in reason(plant, replace(parts, sensors=parts.sensors[1:]), ())
    for perturbation, named in (
        (ThrusterFailure(thruster="sway", at=1.0), "plant FaultyPlant"),
        (SensorFailure(sensor="torque", effect="frozen", field="tau", index=1, at=1.0), "JointTorqueSensors"),
    ):
        loop = assemble(replace(jobs.clean_barrel(quick=True), perturbations=(perturbation,))).loop
        assert named in reason(loop.plant, loop.parts, ())
    loop = assemble(jobs.clean_barrel(quick=True, without=("fusion",))).loop
    assert "RawNavigation" in reason(loop.plant, loop.parts, ())


def ticks_of(plant: Any, parts: Parts) -> type:
    recorder = Recorder(plant.model, timestep=plant.timestep, full=False)
    return type(ticks_for(plant, parts, recorder))


def test_a_controller_without_a_kernel_has_the_rest_compiled_around_it():
    built = assemble(jobs.clean_barrel(quick=True))
    assert ticks_of(built.plant, built.parts) is CompiledTicks
    bare = replace(built.parts, controller=untyped(built.parts.controller).controller)
    assert ticks_of(built.plant, bare) is TicksAround
    for without in ("force-control", "drift-correction"):
        other = assemble(jobs.clean_barrel(quick=True, without=(without,)))
        assert reason(other.loop.plant, other.parts, ()) == ""
        assert ticks_of(other.plant, other.parts) is TicksAround


JOINT_PD = Control(controller="uuv.controllers.whole_body.joint_force_controller:JointForceController")


ABLATED = Control(without=("force-control",))
GUARD = "tests/unit/uuv/ticks/test_compiled_ticks.py::test_a_run_around_a_controller_has_the_same_bits"


@pytest.mark.parametrize(
    ("control", "full"),
    [
        pytest.param(ABLATED, False, id="ablated"),
        pytest.param(JOINT_PD, True, id="own-full"),
        pytest.param(ABLATED, True, marks=pytest.mark.long(guarded_by=GUARD), id="ablated-full"),
        pytest.param(JOINT_PD, False, marks=pytest.mark.long(guarded_by=GUARD), id="own"),
    ],
)
def test_a_run_around_a_controller_has_the_same_bits(control, full):
    one, other = digests(replace(jobs.clean_barrel(quick=True, gust=0.05), control=control), EARLY, full=full)
    assert one == other


@pytest.mark.long
@pytest.mark.parametrize("control", [Control(without=("drift-correction",)), JOINT_PD], ids=["ablated", "own"])
def test_whole_runs_around_a_controller_have_the_same_bits(control):
    one, other = digests(replace(jobs.clean_barrel(quick=True, gust=0.05), control=control), LONGEST, full=False)
    assert one == other


class Wrong:
    """Controller that after a second commands what it is made with."""

    def __init__(self, inner: Any, **change: Any) -> None:
        self.inner, self.period, self.change = inner, inner.period, change

    def init(self, estimate):
        return self.inner.init(estimate)

    def step(self, state, estimate, reference):
        state, command = self.inner.step(state, estimate, reference)
        return state, replace(command, **self.change) if estimate.time > 1.0 else command


@pytest.mark.parametrize("change", [{"joint_torque": np.zeros(5)}, {"thrusters": np.full(6, np.nan)}])
def test_a_command_that_is_none_is_refused_as_part_by_part(change):
    said = []
    for part_by_part in (True, False):
        built = assemble(jobs.clean_barrel(quick=True))
        controller = Wrong(untyped(built.parts.controller).controller, **change)
        loop = replace(built.loop, parts=replace(built.parts, controller=controller))
        with pytest.raises(ConfigurationError) as refused:
            run_through(replace(built, loop=loop), longest=2.0, part_by_part=part_by_part)
        said.append(str(refused.value))
    assert said[0] == said[1]


def test_an_observer_of_every_tick_sees_every_tick():
    counting = EveryTick()
    result = run_through(assemble(jobs.clean_barrel(quick=True)), observers=[counting], longest=0.2)
    assert (counting.calls, result.part_by_part) == (100, "observer EveryTick")


def test_runs_in_threads_have_the_bits_of_runs_in_turn():
    def digest(seed: int) -> str:
        return run_through(assemble(jobs.clean_barrel(quick=True, seed=seed)), longest=1.0).recording.digest(EVERY_STEP)

    in_turn = [digest(seed) for seed in (0, 1)]
    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(digest, (0, 1))) == in_turn
