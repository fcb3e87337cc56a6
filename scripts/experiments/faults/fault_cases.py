"""Fault cases of a contact job, each of which goes on from one run where the faults begin.

The run is not repeated: it is saved at the onsets, and goes on from there with one fault after the
other. At work the faults begin at full push, in other phases shortly after their begin.
"""

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any

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
FARTHER, NEARER = "found 8 cm too deep", "found 5 cm too high"
AT_START = (FARTHER, NEARER)  # these begin before the scan


# RETREAT while the force is ramped down, and after an earlier fault
UNLOAD, ASCENT = "unload", "ascent"
AT_WORK, RETREATING = str(WorkState.WORK), str(WorkState.RETREAT)
PHASES = (
    *map(str, (WorkState.SCAN, WorkState.CLOSE_IN, WorkState.APPROACH, WorkState.PRESS)),
    *(AT_WORK, UNLOAD, RETREATING, ASCENT),
)
_EARLIER = 4  # thruster whose loss at work begins the ascent: a heave thruster


class CaseDoneError(Exception):
    """Raised to end a run once its case is decided."""


@dataclass(slots=True, eq=False)
class Trace:
    """Time series of a run from its fault on, at the loop's rate; times [s] are relative to the
    fault.
    """

    case: str
    phase: str  # one of PHASES, in which the fault began
    began: float  # [s] onset, from the start of the run
    set_force: float  # [N] at the onset
    thruster_names: tuple[str, ...]
    # (N, 11 + m): time, contact [N], felt [N], set [N], hull x y z from its pose at the onset [m],
    # tilt [rad], collision, least and greatest contact of a substep [N], thrusts [N]
    rows: Array
    states: list[tuple[float, WorkState, str]]
    # time, kind and part of each fault that FaultDetection found
    found: list[tuple[float, str, str]]
    blew_up: str = ""


class TraceRecorder:
    """Observer that records the trace, and ends the run in time."""

    def __init__(self, case: str, first: Moment, phase: str) -> None:
        self._case, self._began, self._phase = case, float(first.truth.time), phase
        self._first = first.tick
        at_work = phase in (AT_WORK, UNLOAD, RETREATING, ASCENT)
        self._longest = LONGEST if at_work and case not in AT_START else _LONGER
        self._set = first.reference.set_force
        self._p_WB = np.array(first.truth.p_WB)
        self._up = np.array(first.truth.R_WB[2])
        self.states: list[tuple[float, WorkState, str]] = []
        self.found: list[tuple[float, str, str]] = []
        self._rows: list[tuple[float, ...]] = []
        self._names = first.truth.vehicle.thruster_names
        self._over = np.inf

    def observe(self, moment: Moment) -> None:
        """Records one step after the onset.

        Raises:
            CaseDoneError: The case is decided.
        """
        if moment.tick == self._first:
            return
        truth, reference = moment.truth, moment.reference
        time = truth.time - self._began
        if not self.states or reference.state is not self.states[-1][1]:
            self.states.append((time, reference.state, reference.note))
            if reference.state in (WorkState.DONE, WorkState.ABORT):
                self._over = time
        for fault in moment.command.faults:
            if (str(fault.kind), fault.part) not in (one[1:] for one in self.found):
                self.found.append((time, str(fault.kind), fault.part))
        tilt = float(np.arccos(np.clip(truth.R_WB[2] @ self._up, -1.0, 1.0)))
        self._rows.append(
            (
                time,
                truth.contact_normal,
                moment.command.contact.normal,
                reference.set_force,
                *(truth.p_WB - self._p_WB),
                tilt,
                float(truth.collision),
                truth.contact_least,
                truth.contact_most,
                *truth.thrust,
            )
        )
        if time > self._over + LINGER or time > self._longest:
            raise CaseDoneError

    def trace(self, blew_up: str = "") -> Trace:
        """The trace up to now; `blew_up` is the message of an error that ended the run."""
        return Trace(
            case=self._case,
            phase=self._phase,
            began=self._began,
            set_force=self._set,
            thruster_names=self._names,
            rows=np.array(self._rows),
            states=self.states,
            found=self.found,
            blew_up=blew_up,
        )


class Branching:
    """Finds the steps of a run at which the faults begin, one in each phase.

    Args:
        phases: In which they begin.
        force: [N] set force of the job.
        timestep: [s] of the loop.
    """

    def __init__(self, phases: tuple[str, ...], force: float, timestep: float) -> None:
        self._ascending = ASCENT in phases
        self._full, self._timestep = _FULL * force, timestep
        self._ready, self._now = 0.0, str(WorkState.SETTLE)
        self.left = set(phases)  # those to come
        self.phase = ""  # the one that was found

    def begins(self, moment: Moment) -> bool:
        """True if faults begin at this step, in `phase` then."""
        reference = moment.reference
        phase = self._named(reference)
        at_work = phase == AT_WORK
        begun = phase in self.left and (not at_work or reference.set_force >= self._full)
        self._ready = self._ready + 1.0 if begun and phase == self._now else 0.0
        self._now = phase
        if self._ready * self._timestep <= (_HELD if at_work else _BEGUN):
            return False
        self.left.remove(phase)
        self.phase = phase
        return True

    def _named(self, reference: Reference) -> str:
        """Phase of PHASES, or the state of the work where it is none of them."""
        if reference.state is not WorkState.RETREAT:
            return str(reference.state)
        return ASCENT if self._ascending else UNLOAD if reference.set_force > 0.0 else RETREATING


def thruster_cases(names: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Arguments of `ThrusterFault` by case."""
    dead = {f"thruster {name} dead": {"thruster": i} for i, name in enumerate(names)}
    stuck = {
        f"thruster {name} stuck {how}": {"thruster": i, "stuck": True, "command": command}
        for i, name in enumerate(names)
        for how, command in (("as it was", None), ("ahead", 1.0), ("astern", -1.0))
    }
    return {**dead, **stuck, f"thruster {names[0]} at 60 %": {"thruster": 0, "share": 0.6}}


def chosen_cases(thruster_names: tuple[str, ...], only: tuple[str, ...]) -> list[str]:
    """Names of the cases that contain one of the words `only`; all if it is empty.

    Raises:
        ConfigurationError: No case matches.
    """
    names = [NOTHING, *thruster_cases(thruster_names), DOUBLED, *SENSORS, *AT_START]
    chosen = [name for name in names if not only or any(part in name for part in only)]
    if not chosen:
        raise ConfigurationError(
            f"--only {' '.join(only)}: there is no such case; there are {', '.join(names)}"
        )
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Job:
    """A job that has every fault in it, none of them begun."""

    plant: FaultyPlant
    parts: Parts
    onsets: Mapping[str, Onset]  # of each case
    earlier: Onset  # of the loss that begins the ascent
    force: float  # [N] first set force
    built: Assembly

    @classmethod
    def of(cls, scenario: Scenario, only: tuple[str, ...], *, ascending: bool) -> "_Job":
        """The job of a scenario.

        Args:
            scenario: Surface work.
            only: Parts of names of the cases; empty: all.
            ascending: A heave thruster is lost at work.

        Raises:
            ConfigurationError: No case matches.
        """
        built = assemble(scenario)
        names = built.plant.vehicle.thruster_names
        chosen, force = chosen_cases(names, only), first_force(scenario)
        onsets = {
            name: Onset(duration=SENSORS[name][2] if name in SENSORS else np.inf) for name in chosen
        }
        earlier = Onset(state=WorkState.WORK, force=_FULL * force, after=_HELD)

        how = thruster_cases(names)
        lost = [
            faults.ThrusterFault(onset=onsets[name], **how[name]) for name in how if name in onsets
        ]
        if ascending:
            lost.append(faults.ThrusterFault(thruster=_EARLIER, onset=earlier))
        return cls(
            plant=FaultyPlant(built.plant, lost),
            parts=_with_faults(built.parts, onsets),
            onsets=onsets,
            earlier=earlier,
            force=force,
            built=built,
        )

    def begin(self, *observers: Observer) -> Rollout:
        """A run from the start; each has the same random numbers."""
        built = replace(self.built, noise=deepcopy(self.built.noise))
        doubled = self.onsets.get(DOUBLED)
        profile = None if doubled is None else faults.changing(doubled, 2.0, 1.0)
        built.plant.reset(current=built.current(profile), X_WB=built.X_WB)
        return Rollout(self.plant, self.parts, built.noise, [self.earlier, *observers])

    def trace(self, states: Any, tracer: TraceRecorder, onset: Onset) -> Trace:
        """Goes on from a saved run with one fault.

        Args:
            states: Copy of those of the run and of `earlier`, which is used up.
            tracer: Records the case.
            onset: Of its fault, which begins now.
        """
        run = self.begin(tracer)
        run.resume(states["run"])
        self.earlier.resume(states["earlier"])
        onset.begin(float(self.plant.plant.truth.time))
        blew_up = ""
        try:
            run_on(run, _WHOLE, until=never)
        except CaseDoneError:
            pass
        except Exception as error:
            blew_up = f"{type(error).__name__}: {error}"
        onset.resume(np.inf)
        return tracer.trace(blew_up)


def _with_faults(parts: Parts, onsets: Mapping[str, Onset]) -> Parts:
    """Parts whose sensors and finder have the faults of the cases."""
    sensors = []
    for sensor in parts.sensors:
        for name, (kind, fault, _) in SENSORS.items():
            if name in onsets and type(getattr(sensor, "sound", sensor)) is kind:
                sensor = FaultySensor(sensor, fault, onsets[name])
        sensors.append(sensor)
    finder = parts.finder
    assert finder is not None
    for name, depth in ((FARTHER, -0.08), (NEARER, 0.05)):
        if name in onsets:
            finder = MisplacedFinder(finder, (0.0, 0.0, depth), onsets[name])
    return replace(parts, sensors=sensors, finder=finder)


def run_branched(
    scenario: Scenario,
    only: tuple[str, ...],
    said: Callable[[Trace], None],
    phases: tuple[str, ...] = (AT_WORK,),
) -> None:
    """Runs the job up to the onsets, and from there once for each case.

    Args:
        scenario: Surface work.
        only: Parts of names of the cases to run; empty: all.
        said: Called with the trace of each case.
        phases: In which the faults begin; ASCENT only alone, for its run has an earlier fault.

    Raises:
        ConfigurationError: No case matches, or the job does not come to the first of the phases.
    """
    job, branch = (_Job.of(scenario, only, ascending=ASCENT in phases) for _ in range(2))
    at_start = [case for case in job.onsets if case in AT_START]
    later = [case for case in job.onsets if case not in AT_START]

    def go_on(run: Rollout, moment: Moment, phase: str, cases: list[str]) -> None:
        states = {"run": run.save(), "earlier": job.earlier.save()}
        saved_here = Snapshot(states, "fault study: the state of the run")
        for case in cases:
            tracer = TraceRecorder(case, moment, phase)
            said(branch.trace(saved_here.copy(), tracer, branch.onsets[case]))

    if at_start:
        run = job.begin()
        first = run_on(run, _WHOLE, until=never, pause=lambda _: True)
        go_on(run, first, str(WorkState.SETTLE), at_start)
    if not later:
        return

    # Compiled up to the first of the phases, and from there with every fault in the job.
    start = saved(scenario, min(map(_state_of, phases), key=list(WorkState).index), full=False)
    run = job.begin()
    start.resume(run, None, [job.earlier])
    branching = Branching(phases, job.force, job.plant.timestep)
    branching.begins(run.decide())  # it counts the steps of a phase from the first one on
    while branching.left:
        moment = run_on(run, _WHOLE, until=never, pause=branching.begins)
        if run.stage is not Stage.COMMANDED:
            return
        go_on(run, moment, branching.phase, later)


def _state_of(phase: str) -> WorkState:
    """State of the work in which a phase of PHASES is, or comes."""
    late = {UNLOAD: WorkState.RETREAT, ASCENT: WorkState.WORK}
    return late[phase] if phase in late else WorkState(phase)
