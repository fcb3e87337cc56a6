"""Faults of a contact job, each of which goes on from one run where the faults begin.

The run is not repeated: it is saved at the onset, and goes on from there with one fault after the
other. At work the faults begin at full push, in other phases shortly after their begin.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from uuv.assembly import Assembly, assemble
from uuv.runner import saved
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Reference, WorkState
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.rollout import Moment, Observer, Parts, Rollout, Stage, never, run_on
from uuv.sim.loop.snapshot import Snapshot
from uuv.sim.plant import faults
from uuv.sim.plant.faults import (
    FaultyPlant,
    FaultySensor,
    Fixed,
    Frozen,
    Lost,
    MisplacedFinder,
    Offset,
    Onset,
    Spikes,
    Turned,
)
from uuv.sim.sensors.proprioception import Dvl, Encoders, Imu, JointTorqueSensors, VisionDrift
from uuv.tasks.surface_work import first_force

PathName = Literal["longitudinal", "transverse"]
PATHS: tuple[PathName, ...] = get_args(PathName)

NAN = float("nan")
PUSH = 90.0  # [N] set force at which the faults begin
_FULL = 0.999  # share of the set force from which the push counts as full
_HELD = 0.5  # [s] of full push before the faults begin
_BEGUN = 0.2  # [s] of another phase before they do
LINGER = 6.0  # [s] that a run continues after its work, to see where the vehicle ends up
LONGEST = 20.0  # [s] after the fault, limit of a case at work
_LONGER = 120.0  # [s] after a fault before the contact: the job is to come there
_WHOLE = 200.0  # [s] of the run, limit of all cases

# Sensor faults: kind of sensor, fault, duration [s].
SENSORS: Mapping[str, tuple[type, Any, float]] = {
    "vision lost 3 s": (VisionDrift, Lost(), 3.0),
    "vision lost": (VisionDrift, Lost(), np.inf),
    "vision jumps 5 cm": (VisionDrift, Offset("p_WB", 0, jump=0.05), np.inf),
    "DVL lost": (Dvl, Lost(), np.inf),
    "torque sensor 1 frozen": (JointTorqueSensors, Frozen(("tau",), 0), np.inf),
    "torque sensor 2 frozen": (JointTorqueSensors, Frozen(("tau",), 1), np.inf),
    "torque sensor 3 frozen": (JointTorqueSensors, Frozen(("tau",), 2), np.inf),
    "torque sensor 5 frozen": (JointTorqueSensors, Frozen(("tau",), 4), np.inf),
    "torque sensor 2 drifts 5 N m/s": (JointTorqueSensors, Offset("tau", 1, rate=5.0), np.inf),
    "torque sensor 2 zero": (JointTorqueSensors, Fixed("tau", 1), np.inf),
    "torque sensor 2 spikes 50 N m": (JointTorqueSensors, Spikes("tau", 1, 50.0, 0.02), np.inf),
    "torque sensor 2 NaN": (JointTorqueSensors, Fixed("tau", 1, NAN), np.inf),
    "torque sensors silent": (JointTorqueSensors, Lost(), np.inf),
    "encoder 1 stuck": (Encoders, Frozen(("q", "qd"), 0), np.inf),
    "encoder 2 stuck": (Encoders, Frozen(("q", "qd"), 1), np.inf),
    "encoder 2 angle stuck": (Encoders, Frozen(("q",), 1), np.inf),
    "encoder 3 NaN": (Encoders, Fixed("q", 2, NAN), np.inf),
    "IMU NaN": (Imu, Fixed("specific_force_B", 0, NAN), np.inf),
    "IMU NaN 10 ms": (Imu, Fixed("specific_force_B", 0, NAN), 0.01),
    "IMU silent": (Imu, Lost(), np.inf),
    "IMU bias jumps 0.05 m/s2": (Imu, Offset("specific_force_B", 0, jump=0.05), np.inf),
    "gyro x jumps 0.003 rad/s": (Imu, Offset("w_WB_B", 0, jump=0.003), np.inf),
    "gyro y jumps 0.03 rad/s": (Imu, Offset("w_WB_B", 1, jump=0.03), np.inf),
    "gyro z jumps 0.3 rad/s": (Imu, Offset("w_WB_B", 2, jump=0.3), np.inf),
    "gyro frozen": (Imu, Frozen(("w_WB_B",)), np.inf),
    "attitude z jumps 1 deg": (Imu, Turned(2, jump=np.radians(1.0)), np.inf),
    "attitude x drifts 0.03 rad/s": (Imu, Turned(0, rate=0.03), np.inf),
}
NOTHING = "nothing"
DOUBLED = "current doubled in 1 s"
FARTHER = "found 8 cm too deep"
NEARER = "found 5 cm too high"
AT_START = (FARTHER, NEARER)  # these begin before the scan

PhaseName = Literal["scan", "close-in", "approach", "press", "work", "unload", "retreat", "ascent"]
PHASES: tuple[PhaseName, ...] = get_args(PhaseName)
SETTLE = str(WorkState.SETTLE)  # phase of AT_START
AT_WORK = str(WorkState.WORK)
RETREATING = str(WorkState.RETREAT)
UNLOAD = "unload"  # RETREAT while the force is ramped down
ASCENT = "ascent"  # RETREAT after an earlier fault
# State up to which the run to a phase is compiled, where it has another name.
_STATE_BEFORE = {UNLOAD: RETREATING, ASCENT: AT_WORK}
_EARLIER = 4  # thruster whose loss at work begins the ascent: a heave thruster


class CaseDoneError(Exception):
    """Raised to end a run once its case is decided."""


@dataclass(slots=True, eq=False)
class Trace:
    """Time series of a run from its fault on, at the loop's rate; times [s] from the fault."""

    fault: str
    phase: str  # SETTLE or one of PHASES, in which the fault began
    set_force: float  # [N] at the onset
    thruster_names: tuple[str, ...]

    # (N,) each: time [s], contact_normal, contact_least, contact_most (of a substep), felt,
    # set_force [N], tilt [rad], collision; moved (N, 3) [m] from the hull's pose at the onset in W,
    # thrust (N, m) [N]
    series: Mapping[str, Array]
    states: list[tuple[float, WorkState, str]]  # each from its first step on, with its note
    reports: list[tuple[float, str, str]]  # time, kind and part of each fault that was detected
    blew_up: str = ""  # message of the error that ended the run


class TraceRecorder:
    """Observer that records the trace, and ends the run in time."""

    def __init__(self, fault: str, first: Moment, phase: str) -> None:
        self._fault = fault
        self._phase = phase
        at_work = phase in (AT_WORK, UNLOAD, RETREATING, ASCENT)
        self._longest = LONGEST if at_work else _LONGER

        # what the trace is relative to
        self._first = first.tick
        self._began = float(first.truth.time)
        self._set = first.reference.set_force
        self._p_WB = np.array(first.truth.p_WB)
        self._up = np.array(first.truth.R_WB[2])
        self._names = first.truth.vehicle.thruster_names

        self._states: list[tuple[float, WorkState, str]] = []
        self._reports: list[tuple[float, str, str]] = []
        self._steps: list[dict[str, Any]] = []
        self._over = np.inf

    def observe(self, moment: Moment) -> None:
        """Records one step after the onset.

        Raises:
            CaseDoneError: The case is decided.
        """
        if moment.tick == self._first:
            return
        truth = moment.truth
        reference = moment.reference
        time = truth.time - self._began

        # what the vehicle does, and what it reports
        if not self._states or reference.state is not self._states[-1][1]:
            self._states.append((time, reference.state, reference.note))
            if reference.state in (WorkState.DONE, WorkState.ABORT):
                self._over = time
        for fault in moment.command.faults:
            if (str(fault.kind), fault.part) not in (report[1:] for report in self._reports):
                self._reports.append((time, str(fault.kind), fault.part))

        # what happens to it
        tilt = float(np.arccos(np.clip(truth.R_WB[2] @ self._up, -1.0, 1.0)))
        self._steps.append(
            {
                "time": time,
                "contact_normal": truth.contact_normal,
                "contact_least": truth.contact_least,
                "contact_most": truth.contact_most,
                "felt": moment.command.contact.normal,
                "set_force": reference.set_force,
                "moved": truth.p_WB - self._p_WB,
                "tilt": tilt,
                "collision": float(truth.collision),
                "thrust": np.array(truth.thrust),
            }
        )
        if time > self._over + LINGER or time > self._longest:
            raise CaseDoneError

    def trace(self, blew_up: str = "") -> Trace:
        """The trace up to now; `blew_up` is the message of an error that ended the run."""
        names = self._steps[0] if self._steps else ()
        return Trace(
            fault=self._fault,
            phase=self._phase,
            set_force=self._set,
            thruster_names=self._names,
            series={name: np.array([step[name] for step in self._steps]) for name in names},
            states=self._states,
            reports=self._reports,
            blew_up=blew_up,
        )


class PhaseBegin:
    """Finds the step of a run at which the fault of a phase begins.

    Args:
        phase: Of PHASES.
        force: [N] set force of the job.
        timestep: [s] of the loop.
    """

    def __init__(self, phase: str, force: float, timestep: float) -> None:
        self._phase = phase
        self._full = _FULL * force
        self._timestep = timestep
        self._steps = 0  # for which the phase has lasted, the first one not counted
        self._now = SETTLE

    def begins(self, moment: Moment) -> bool:
        """True if the fault begins at this step."""
        reference = moment.reference
        at_work = self._phase == AT_WORK
        before = self._now
        self._now = self._phase_of(reference)

        lasts = self._now == before == self._phase
        lasts &= not at_work or reference.set_force >= self._full
        self._steps = self._steps + 1 if lasts else 0
        return self._steps * self._timestep > (_HELD if at_work else _BEGUN)

    def _phase_of(self, reference: Reference) -> str:
        """Phase of PHASES, or the state of the work where it is none of them."""
        if reference.state is not WorkState.RETREAT:
            return str(reference.state)
        if self._phase == ASCENT:
            return ASCENT
        return UNLOAD if reference.set_force > 0.0 else RETREATING


def thruster_cases(names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Arguments of `ThrusterFault` by fault."""
    dead = {f"thruster {name} dead": {"thruster": i} for i, name in enumerate(names)}
    stuck = {
        f"thruster {name} stuck {how}": {"thruster": i, "stuck": True, "command": command}
        for i, name in enumerate(names)
        for how, command in (("as it was", None), ("ahead", 1.0), ("astern", -1.0))
    }
    return {**dead, **stuck, f"thruster {names[0]} at 60 %": {"thruster": 0, "share": 0.6}}


def fault_names(thruster_names: tuple[str, ...]) -> tuple[str, ...]:
    """Names of all faults of a vehicle with these thrusters."""
    return (NOTHING, *thruster_cases(thruster_names), DOUBLED, *SENSORS, *AT_START)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Job:
    """A job that has every fault in it, none of them begun."""

    plant: FaultyPlant
    parts: Parts
    onsets: Mapping[str, Onset]  # of each fault
    earlier: Onset  # of the loss that begins the ascent
    built: Assembly

    @classmethod
    def of(cls, scenario: Scenario, *, ascending: bool) -> "_Job":
        """The job of a scenario.

        Args:
            scenario: Surface work.
            ascending: A heave thruster is lost at work.
        """
        built = assemble(scenario)
        names = built.plant.vehicle.thruster_names
        onsets = {
            name: Onset(duration=SENSORS[name][2] if name in SENSORS else np.inf)
            for name in fault_names(names)
        }
        earlier = Onset(state=WorkState.WORK, force=_FULL * first_force(scenario), after=_HELD)

        lost = [
            faults.ThrusterFault(onset=onsets[name], **how)
            for name, how in thruster_cases(names).items()
        ]
        if ascending:
            lost.append(faults.ThrusterFault(thruster=_EARLIER, onset=earlier))
        return cls(
            plant=FaultyPlant(built.plant, lost),
            parts=_with_faults(built.parts, onsets),
            onsets=onsets,
            earlier=earlier,
            built=built,
        )

    def begin(self, *observers: Observer) -> Rollout:
        """A run from the start; each has the same random numbers."""
        built = replace(self.built, noise=deepcopy(self.built.noise))
        profile = faults.changing(self.onsets[DOUBLED], 2.0, 1.0)
        built.plant.reset(current=built.current(profile), X_WB=built.X_WB)
        return Rollout(self.plant, self.parts, built.noise, [self.earlier, *observers])


def _with_faults(parts: Parts, onsets: Mapping[str, Onset]) -> Parts:
    """Parts whose sensors and finder have the faults."""
    sensors = []
    for sensor in parts.sensors:
        for name, (kind, fault, _) in SENSORS.items():
            if type(getattr(sensor, "sound", sensor)) is kind:
                sensor = FaultySensor(sensor, fault, onsets[name])
        sensors.append(sensor)

    finder = parts.finder
    assert finder is not None
    for name, depth in ((FARTHER, -0.08), (NEARER, 0.05)):
        finder = MisplacedFinder(finder, (0.0, 0.0, depth), onsets[name])
    return replace(parts, sensors=sensors, finder=finder)


class Branch:
    """A run up to the onset of a phase, which goes on from there with one fault after the other.

    Args:
        scenario: Surface work.
        phase: SETTLE, before the scan, or one of PHASES; before ASCENT a heave thruster is lost.

    Raises:
        ConfigurationError: The job does not come to that phase.
    """

    def __init__(self, scenario: Scenario, phase: str) -> None:
        self._phase = phase
        job = _Job.of(scenario, ascending=phase == ASCENT)
        run = job.begin()
        self._first = _at_onset(run, job, scenario, phase)

        # The first step stays as it is: what goes on from there is another job.
        states = {"run": run.save(), "earlier": job.earlier.save()}
        self._states = Snapshot(states, "the state of the run")
        self._job = _Job.of(scenario, ascending=phase == ASCENT)

    def trace(self, fault: str) -> Trace:
        """Goes on with one fault, which begins now."""
        recorder = TraceRecorder(fault, self._first, self._phase)
        states = self._states.copy()
        run = self._job.begin(recorder)
        run.resume(states["run"])
        self._job.earlier.resume(states["earlier"])

        onset = self._job.onsets[fault]
        onset.begin(float(self._job.plant.plant.truth.time))
        blew_up = ""
        try:
            run_on(run, _WHOLE, until=never)
        except CaseDoneError:
            pass
        except Exception as error:
            blew_up = f"{type(error).__name__}: {error}"
        onset.resume(np.inf)
        return recorder.trace(blew_up)


def _at_onset(run: Rollout, job: _Job, scenario: Scenario, phase: str) -> Moment:
    """Runs a job up to the onset of a phase, its first step if that is SETTLE.

    Raises:
        ConfigurationError: It does not come to it.
    """
    if phase == SETTLE:
        return run_on(run, _WHOLE, until=never, pause=lambda _: True)

    # Compiled up to the state of the phase, and from there with every fault in the job.
    start = saved(scenario, _STATE_BEFORE.get(phase, phase), full=False)
    start.resume(run, None, [job.earlier])
    begin = PhaseBegin(phase, first_force(scenario), job.plant.timestep)
    begin.begins(run.decide())  # it counts the steps of a phase from the first one on
    moment = run_on(run, _WHOLE, until=never, pause=begin.begins)

    if run.stage is not Stage.COMMANDED:
        raise ConfigurationError(
            f"phase: {phase} was not reached; the run ended at {moment.truth.time:.1f} s in "
            f"{moment.reference.state}"
        )
    return moment
