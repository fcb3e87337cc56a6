"""A job's site with an operator in place of the planner, and figures of the operator's work."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from uuv.controllers.driving.gamepad_inputs import GamepadInputs
from uuv.controllers.driving.key_inputs import KeyInputs
from uuv.controllers.driving.operator_inputs import LONGEST, OperatorInputs
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import GAMEPAD, INPUTS_FILE, KEYBOARD, Operator, PlacedTask, Scenario
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.schemas import unmeasured
from uuv.sim.evaluation.surface.force_levels import ForceSteps, is_lost
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.runs.saving import write_whole

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.tasks.task import TaskPlanner
    from uuv.outcome import RunResult
    from uuv.perception.clouds.scan import SensorModel
    from uuv.sim.interfaces.protocols import Controller, Estimator, Sensor, TargetFinder
    from uuv.sim.interfaces.spatial import Array
    from uuv.sim.loop.recording import Recording

_AROUND = 150.0  # [s] simulated time before the first input, and after the last
# [s] between tip positions whose distances add up to the path length, so that jitter does not count
_STRIDE = 0.1
_FORCE_ERROR = 15.0  # [N] RMS, acceptance bound
_EXCESS = 1.5  # largest overshoot of the true force, as a share of the set force


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFigures:
    """Figures of an operator's work with the tool."""

    pressed_s: float | None  # time under force control
    force_error_rms_n: float | None  # true force less set force, where the set force has settled
    force_peak_n: float | None  # largest true force in the whole run
    force_peak_share: float | None  # ratio to the largest set force
    wiped_m: float | None  # path length of the tool along the surface under force control


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveMetrics:
    """Figures of a driven run."""

    drive: DriveFigures


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenWork(PlacedTask):
    """Work at the site of a task, driven by an operator; only the site of the task is used."""

    begun: ClassVar[tuple[WorkState, ...]] = (
        WorkState.CLOSE_IN,
        WorkState.APPROACH,
        WorkState.WORK,
    )
    work: PlacedTask
    vehicle: OwnVehicle  # the vehicle's model of itself
    operator: Operator
    source: OperatorInputs

    @classmethod
    def of(cls, work: PlacedTask, scenario: Scenario, vehicle: OwnVehicle) -> Self:
        """The work of a scenario with an operator.

        Raises:
            ConfigurationError: There is no operator, or the operator's inputs cannot be read.
        """
        operator = scenario.control.operator
        if operator is None:
            raise ConfigurationError(
                f"scenario {scenario.name!r} must have an operator (key `operator`), got none"
            )
        live = {KEYBOARD: KeyInputs, GAMEPAD: GamepadInputs}.get(operator.inputs)
        source = OperatorInputs.read(operator.inputs) if live is None else live()
        return cls(work=work, vehicle=vehicle, operator=operator, source=source)

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"{self.work.title}, driven with {self.operator.delay:g} s of delay"

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time: duration of the inputs, and the time before and after
        them.
        """
        driven = min(self.source.duration, LONGEST) + self.operator.delay
        return _AROUND + math.ceil(driven)  # a whole number of steps for any physics step

    @property
    def X_WB(self) -> "Array":
        """Initial hull pose of the task."""
        return self.work.X_WB

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """The site of the task."""
        return self.work.scene(vehicle)

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """Sensors of the task."""
        return self.work.sensors(model)

    def estimator(self, navigation: "Estimator") -> "Estimator":
        """Estimator of the task."""
        return self.work.estimator(navigation)

    def finder(self, sensor: "SensorModel | None", seed: int) -> "TargetFinder | None":
        """None: the operator has no finder."""
        del sensor, seed

    def controller(self) -> "Controller | None":
        """Controller of the task."""
        return self.work.controller()

    def planner(self) -> "TaskPlanner":
        """The operator, in place of a planner."""
        from uuv.controllers.driving.driven_task import driven_task

        known = self.vehicle.at_work()
        return driven_task(known, self.source, self.operator.delay, X_WB=self.X_WB)

    def assess(self, ran: "RunResult", seed: int) -> Assessment:
        """Force error and peak compared with their bounds, if a force was set."""
        figures = drive_figures(ran.recording)
        # A drive without force control has no bounds.
        pressed = figures.pressed_s is not None
        checks = [
            Requirement("time under force control", figures.pressed_s, None, "s"),
            Requirement(
                "force error, RMS",
                figures.force_error_rms_n,
                _FORCE_ERROR if pressed else None,
                "N",
            ),
            Requirement(
                "force over set force, peak",
                figures.force_peak_share,
                _EXCESS if pressed else None,
                "-",
            ),
            Requirement("way along the surface", figures.wiped_m, None, "mm", 1e3),
        ]

        metrics = DriveMetrics(drive=figures)
        return Assessment.of(ran.recording, metrics, checks, seed=seed, wall_s=ran.wall_s)

    def write_files(self, folder: Path) -> tuple[Path, ...]:
        """Write the inputs, with which the run can be repeated."""
        file = folder / INPUTS_FILE
        write_whole(file, self.source.text())
        return (file,)


def drive_figures(recording: "Recording") -> DriveFigures:
    """Force and path length of a driven tool; None if no force was set."""
    work = recording.within(WorkState.WORK)
    if not work.any():
        return unmeasured(DriveFigures)

    steps = ForceSteps.of(recording)
    normal = recording["contact_normal"].scalar
    error = (normal - steps.force)[work & steps.settled & (steps.force > 0.0)]
    peak = float(recording["contact_most"].scalar.max())
    largest = float(recording["set_force"].scalar.max())

    touches = work & ~is_lost(recording["contact_least"].scalar)
    rows = slice(None, None, max(1, math.ceil(_STRIDE / recording.timestep)))
    tip, axis = (recording[name].value[rows] for name in ("p_pad", "tool_axis"))
    return DriveFigures(
        pressed_s=float(work.sum() * recording.timestep),
        force_error_rms_n=float(np.sqrt(np.mean(error**2))) if error.size else None,
        force_peak_n=peak,
        force_peak_share=peak / largest if largest > 0.0 else None,
        wiped_m=way_across(tip, axis, touches[rows]),
    )


def way_across(tip: "Array", axis: "Array", touches: np.ndarray) -> float:
    """Path length [m] of a tip across the tool axis, between neighbouring rows that are both in
    contact.

    Args:
        tip: (N, 3) [m], W.
        axis: (N, 3) unit tool axis, W.
        touches: (N,) bool: in contact.
    """
    step = np.diff(tip, axis=0)
    across = step - np.sum(step * axis[:-1], axis=1)[:, None] * axis[:-1]
    return float(np.linalg.norm(across, axis=1)[touches[1:] & touches[:-1]].sum())
