"""A job's site with an operator in place of the planner, and the figures of what he did there."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from uuv.controllers.driving.key_inputs import KeyInputs
from uuv.controllers.driving.operator_inputs import LONGEST, OperatorInputs
from uuv.own_vehicle import OwnVehicle
from uuv.scenario import INPUTS_FILE, KEYBOARD, Operator, PlacedTask, Scenario
from uuv.sim.evaluation.force_levels import ForceSteps, is_lost
from uuv.sim.evaluation.metrics import Assessment, Requirement
from uuv.sim.evaluation.schemas import unmeasured
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

_AROUND = 150.0  # [s] simulated before the inputs begin, and after they end
_STRIDE = 0.1  # [s] between the places of the tip whose distances are a way: its jitter is none
_FORCE_ERROR = 15.0  # [N] RMS, acceptance bound
_EXCESS = 1.5  # share of the set force that the true one may reach


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveFigures:
    """What an operator did with the tool."""

    pressed_s: float | None  # under force control
    force_error_rms_n: float | None  # true less set force, where that has settled
    force_peak_n: float | None  # true, in the whole run
    force_peak_share: float | None  # of the largest set force
    wiped_m: float | None  # way of the tool along the surface under force control


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveMetrics:
    """Figures of a driven run."""

    drive: DriveFigures


@dataclass(frozen=True, kw_only=True, eq=False)
class DrivenWork(PlacedTask):
    """Work of a task at its site, driven by an operator; of the task only the site remains."""

    begun: ClassVar[tuple[WorkState, ...]] = (
        WorkState.CLOSE_IN,
        WorkState.APPROACH,
        WorkState.WORK,
    )
    work: PlacedTask
    vehicle: OwnVehicle  # as it knows itself
    operator: Operator
    source: OperatorInputs

    @classmethod
    def of(cls, work: PlacedTask, scenario: Scenario, vehicle: OwnVehicle) -> Self:
        """The work of a scenario with an operator.

        Raises:
            ConfigurationError: There is no operator, or his inputs cannot be read.
        """
        operator = scenario.control.operator
        if operator is None:
            raise ConfigurationError(f"scenario {scenario.name!r} has no operator")
        live = operator.inputs == KEYBOARD
        source = KeyInputs() if live else OperatorInputs.read(operator.inputs)
        return cls(work=work, vehicle=vehicle, operator=operator, source=source)

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"{self.work.title}, driven with {self.operator.delay:g} s of delay"

    @property
    def longest(self) -> float:
        """Limit [s] of the simulated time: the inputs, and what goes before and after them."""
        driven = min(self.source.duration, LONGEST) + self.operator.delay
        return _AROUND + math.ceil(driven)  # whole steps of any physics

    @property
    def X_WB(self) -> "Array":
        """That of the task."""
        return self.work.X_WB

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """The site of the task."""
        return self.work.scene(vehicle)

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """Those of the task."""
        return self.work.sensors(model)

    def estimator(self, navigation: "Estimator") -> "Estimator":
        """That of the task."""
        return self.work.estimator(navigation)

    def finder(self, sensor: "SensorModel | None", seed: int) -> "TargetFinder | None":
        """None: the operator looks for himself."""
        del sensor, seed

    def controller(self) -> "Controller | None":
        """That of the task."""
        return self.work.controller()

    def planner(self) -> "TaskPlanner":
        """The operator's."""
        from uuv.controllers.driving.driven_task import driven_task

        known = self.vehicle.at_work()
        return driven_task(known, self.source, self.operator.delay, X_WB=self.X_WB)

    def assess(self, ran: "RunResult", seed: int) -> Assessment:
        """Force error and peak against their bounds, where a force was set."""
        figures = drive_figures(ran.recording)
        # Of a drive without force control nothing is asked.
        pressed = figures.pressed_s is not None
        checks = [
            Requirement("time in contact", figures.pressed_s, None, "s"),
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
        """The inputs, by which the run can be repeated."""
        file = folder / INPUTS_FILE
        write_whole(file, self.source.text())
        return (file,)


def drive_figures(recording: "Recording") -> DriveFigures:
    """Force and way of a driven tool; None where no force was set."""
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
    """Way [m] of a tip across the tool axis, between neighbouring rows that are both in contact.

    Args:
        tip: (N, 3) [m], W.
        axis: (N, 3) unit tool axis, W.
        touches: (N,) bool: in contact.
    """
    step = np.diff(tip, axis=0)
    across = step - np.sum(step * axis[:-1], axis=1)[:, None] * axis[:-1]
    return float(np.linalg.norm(across, axis=1)[touches[1:] & touches[:-1]].sum())
