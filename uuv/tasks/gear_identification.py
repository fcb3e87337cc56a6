"""Identification of the gears' friction by the hovering vehicle: run, evaluation, page."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.random import Generator

from uuv.models.naming import CAMERA_SITE, TOOL_GEOM
from uuv.outcome import RunResult
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sim.evaluation.friction_metrics import (
    FrictionMetrics,
    FrictionParameter,
    FrictionRunMetrics,
    JointFriction,
)
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import Array, finite_number, pose
from uuv.sim.loop.rollout import Moment
from uuv.site import OpenWater
from uuv.tasks.approach import object_of

if TYPE_CHECKING:
    import mujoco
    from matplotlib.figure import Figure
    from rich.table import Table

    from uuv.controllers.estimation.friction_identification import (
        FrictionMotion,
        IdentifiedFriction,
    )
    from uuv.models.arms.gear_friction import DryFriction
    from uuv.models.vehicle import Vehicle
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.sim.evaluation.assessment import Assessment

SHORTEST, LONGEST = 10.0, 300.0  # [s] of swings
DEPTH = 2.0  # [m] of the hull
SLOW_SHARE = 2.0 / 3.0  # of the swings' duration, for the slow turn; two fast turns share the rest
USUAL = 0.04  # usual Coulomb friction of a gear, share of the drive's torque limit
QUANTITIES = {  # name in `IdentifiedFriction.sigma`: words for the table
    "coulomb": "Coulomb [N m]",
    "stiction": "stiction [N m]",
    "viscous": "viscous [N m s/rad]",
    "stribeck_speed": "Stribeck speed [rad/s]",
}
_SHOWN = 4000  # largest number of samples of each joint in the picture


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionBounds:
    """Bounds on errors of the worst joint, as shares of the true value or, if it is 0, of USUAL."""

    coulomb: float = 0.02
    stiction: float = 0.05
    viscous: float = 0.05
    sigmas: float = 5.0  # largest error over its standard deviation


class FrictionSamples:
    """Observer that keeps encoder speeds, torque readings and motor torques while the joints swing.

    A torque reading is of the step that has ended, so it goes with the motor torque of the command
    before.
    """

    def __init__(self) -> None:
        self._rows: list[tuple[Array, Array, Array]] = []
        self._motor: Array | None = None

    def observe(self, moment: Moment) -> None:
        """Keeps one row in the state WORK."""
        if self._motor is not None and moment.reference.state is WorkState.WORK:
            self._rows.append((moment.estimate.qd.copy(), moment.estimate.tau.copy(), self._motor))
        self._motor = moment.command.joint_torque.copy()

    def save(self) -> tuple[list[tuple[Array, Array, Array]], Array | None]:
        """Rows so far, and the last motor torques."""
        return self._rows, self._motor

    def resume(self, saved: tuple[list[tuple[Array, Array, Array]], Array | None]) -> None:
        """Continue from a result of `save`."""
        self._rows, self._motor = saved

    def columns(self) -> tuple[Array, Array, Array]:
        """Speeds [rad/s], torques at the gear outputs and motor torques [N m], each (N, n).

        Raises:
            ConfigurationError: No sample was taken.
        """
        if len(self._rows) < 2:
            raise ConfigurationError("friction: the run ended before the joints swung")
        qd, gear, motor = (np.array([row[i] for row in self._rows]) for i in range(3))
        return qd, gear, motor


@dataclass(frozen=True, kw_only=True)
class GearIdentificationTask(Task):
    """Swing the joints of the hovering vehicle, free of contact, to identify gear friction."""

    schema: ClassVar[str] = "friction"
    spares: ClassVar[Collection[str]] = (CAMERA_SITE, TOOL_GEOM)
    seconds: float = option(30.0, "Duration of the swings [s], after 4 s of unfolding.")

    def __post_init__(self) -> None:
        finite_number(self.seconds, "task.seconds [s]", least=SHORTEST, most=LONGEST)

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses a site with an object."""
        super().check_inputs(scenario)
        object_of(scenario, OpenWater)

    def place(self, scenario: Scenario, own: "OwnVehicle", rng: Generator) -> "FrictionCase":
        """The swings in open water."""
        object_of(scenario, OpenWater)
        return FrictionCase(scenario=scenario, task=self, believed=own.vehicle)


@dataclass(kw_only=True, eq=False)
class FrictionCase(PlacedTask):
    """Swings in open water, with the believed and the true friction of the gears."""

    exact_start: ClassVar[bool] = True
    scenario: Scenario
    task: GearIdentificationTask
    believed: "Vehicle"
    samples: FrictionSamples = field(default_factory=FrictionSamples)
    model: "mujoco.MjModel | None" = None  # of the plant; `sensors` sets it
    identification: "IdentifiedFriction | None" = None  # `assess` sets it

    @property
    def title(self) -> str:
        """Title of log and report."""
        vehicle = self.scenario.vehicle.vehicle
        seconds = self.task.seconds
        return (
            f"Friction of the gears of {vehicle}, swings of {seconds:g} s, seed "
            f"{self.scenario.seed}"
        )

    @property
    def X_WB(self) -> Array:
        """Pose of the hull, DEPTH below the surface."""
        return pose(p=[0.0, 0.0, -DEPTH])

    @property
    def true(self) -> "Vehicle":
        """The true vehicle."""
        from uuv.models.vehicle import Vehicle

        assert self.model is not None
        return Vehicle.of(self.model)

    @property
    def timestep(self) -> float:
        """Time [s] between two samples."""
        assert self.model is not None
        return float(self.model.opt.timestep)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """The vehicle alone."""
        return vehicle

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """None: no sensor observes the site."""
        self.model = model
        return [], None

    def planner(self) -> "FrictionMotion":
        """Slow swings, then fast ones."""
        from uuv.controllers.estimation.friction_identification import FrictionMotion

        seconds = self.task.seconds
        slow, fast = SLOW_SHARE * seconds, 0.5 * (1.0 - SLOW_SHARE) * seconds
        return FrictionMotion(self.believed, self.X_WB, slow=slow, fast=fast)

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Identifies the friction and compares it with the true one."""
        try:
            self.identification = identified(self)
        except ConfigurationError:
            if not ran.recording.interrupted:
                raise
        return assessed(self, self.identification, ran)

    def tables(self) -> "Iterator[Table]":
        """Friction joint by joint."""
        if self.identification is not None:
            yield joint_table(self, self.identification)

    def pictures(self, ran: RunResult) -> Iterator[tuple[str, str, "Figure"]]:
        """Torque lost over speed."""
        if self.identification is not None:
            caption = (
                "Torque lost in each gear over its speed: samples, the identified curve, the true "
                "one, and belief."
            )
            yield "Friction", caption, curves(self, self.identification)

    def observers(self) -> tuple[FrictionSamples, ...]:
        """The samples of the swings."""
        return (self.samples,)


def identified(case: FrictionCase) -> "IdentifiedFriction":
    """Friction identified from the samples; rotor inertias are taken as known.

    Raises:
        ConfigurationError: A joint moved too little.
    """
    from uuv.controllers.estimation.friction_identification import identify_friction, over_steps

    qd, gear, motor = case.samples.columns()
    speed, acceleration = over_steps(qd, case.timestep)
    return identify_friction(speed, acceleration, motor[1:], gear[1:], case.believed.armature)


def values_of(viscous: Array, dry: "DryFriction") -> dict[str, Array]:
    """The arrays (n,) of a friction by the names of QUANTITIES."""
    return {
        "viscous": viscous,
        **{name: getattr(dry, name) for name in ("coulomb", "stiction", "stribeck_speed")},
    }


def errors(case: FrictionCase, fitted: "IdentifiedFriction") -> dict[str, Array]:
    """Errors (n,) of Coulomb friction, stiction and viscous friction, as in FrictionBounds."""
    got, true = (
        values_of(fitted.viscous, fitted.dry),
        values_of(case.true.joint_damping, case.true.dry_friction),
    )

    usual = USUAL * np.asarray(case.true.torque_limits)
    over = {
        "coulomb": usual,
        "stiction": usual,
        "viscous": usual / np.abs(case.samples.columns()[0]).max(axis=0),
    }

    return {
        name: np.abs(got[name] - true[name]) / np.where(true[name] > 0.0, true[name], instead)
        for name, instead in over.items()
    }


def assessed(
    case: FrictionCase, fitted: "IdentifiedFriction | None", ran: RunResult
) -> "Assessment":
    """Metrics of the run: friction of each joint and the errors of the worst, by FrictionBounds.

    Args:
        case: The vehicle.
        fitted: The identified friction; None: the run was interrupted before.
        ran: The run.
    """
    from uuv.sim.evaluation.assessment import Assessment

    bounds = FrictionBounds()
    figures: dict[str, Any] = dict.fromkeys(
        ("coulomb_error", "stiction_error", "viscous_error", "error_sigmas")
    )
    joints: list[JointFriction] = []

    if fitted is not None:
        true = values_of(case.true.joint_damping, case.true.dry_friction)
        believed = values_of(case.believed.joint_damping, case.believed.dry_friction)
        got = values_of(fitted.viscous, fitted.dry)
        shares = errors(case, fitted)

        # Errors of the worst joint, also in standard deviations.
        figures = {f"{name}_error": float(share.max()) for name, share in shares.items()}
        off = [np.abs(got[name] - true[name]) / fitted.sigma(name) for name in shares]
        figures["error_sigmas"] = float(np.max(off))

        joints = [
            JointFriction(
                name=name,
                sensor_bias_nm=float(fitted.bias[j]),
                residual_nm=float(fitted.residual[j]),
                **{
                    word: FrictionParameter(
                        believed=float(believed[word][j]),
                        identified=float(got[word][j]),
                        sigma=float(sigma) if np.isfinite(sigma := fitted.sigma(word)[j]) else None,
                        true=float(true[word][j]),
                    )
                    for word in QUANTITIES
                },
            )
            for j, name in enumerate(case.true.joint_names)
        ]

    checks = [
        Requirement(
            f"{words}, error of the worst joint",
            figures[f"{name}_error"],
            getattr(bounds, name),
            "%",
            100.0,
        )
        for name, words in (
            ("coulomb", "Coulomb friction"),
            ("stiction", "stiction"),
            ("viscous", "viscous friction"),
        )
    ]
    checks.append(Requirement("largest error", figures["error_sigmas"], bounds.sigmas, "sigma"))

    content = FrictionRunMetrics(friction=FrictionMetrics(**figures, joints=joints))
    return Assessment.of(ran.recording, content, checks, seed=case.scenario.seed, wall_s=ran.wall_s)


def joint_table(case: FrictionCase, fitted: "IdentifiedFriction") -> "Table":
    """Table of each joint: believed, identified with its standard deviation, true.

    Those of a slide are in N and m.
    """
    from rich.table import Table
    from rich.text import Text

    table = Table(title="friction of the gears", title_justify="left")
    for column in ("joint", "figure"):
        table.add_column(column)
    for column in ("believed", "identified", "± sigma", "true"):
        table.add_column(column, justify="right", no_wrap=True)

    true = values_of(case.true.joint_damping, case.true.dry_friction)
    believed = values_of(case.believed.joint_damping, case.believed.dry_friction)
    got = values_of(fitted.viscous, fitted.dry)
    for j, joint in enumerate(case.true.joint_names):
        for word, figure in QUANTITIES.items():
            sigma = float(fitted.sigma(word)[j])
            if not np.isfinite(sigma):  # without stiction there is no Stribeck speed
                continue
            digits = int(np.clip(1 - np.floor(np.log10(sigma)), 0, 6)) if sigma > 0.0 else 6
            cells = (
                f"{value:.{digits}f}"
                for value in (believed[word][j], got[word][j], sigma, true[word][j])
            )
            table.add_row(joint if word == "coulomb" else "", Text(figure), *cells)

        table.add_section()
    return table


def curves(case: FrictionCase, fitted: "IdentifiedFriction") -> "Figure":
    """Torque lost over speed, one plot for each joint."""
    from matplotlib.figure import Figure

    from uuv.controllers.estimation.friction_identification import over_steps

    # Torque lost in the gears: what the motor gives beyond inertia and the sensor's reading.
    qd, gear, motor = case.samples.columns()
    speed, acceleration = over_steps(qd, case.timestep)
    lost = motor[1:] - case.believed.armature * acceleration - gear[1:] - fitted.bias

    n = len(case.true.joint_names)
    across = min(n, 3)
    figure = Figure(figsize=(3.4 * across, 2.8 * -(-n // across)), layout="constrained")
    every = max(1, len(speed) // _SHOWN)

    drawn = (
        ("believed", case.believed.joint_damping, case.believed.dry_friction, "0.5", ":"),
        ("true", case.true.joint_damping, case.true.dry_friction, "k", "-"),
        ("identified", fitted.viscous, fitted.dry, "tab:orange", "--"),
    )

    for j, name in enumerate(case.true.joint_names):
        axes = figure.add_subplot(-(-n // across), across, j + 1)
        axes.plot(
            speed[::every, j],
            lost[::every, j],
            ".",
            ms=1.0,
            color="tab:blue",
            alpha=0.3,
            label="samples",
        )

        # The laws: viscous, Coulomb and Stribeck friction.
        top = float(np.abs(speed[:, j]).max())
        for label, viscous, dry, colour, style in drawn:
            for sign in (-1.0, 1.0):
                v = sign * np.linspace(1e-4, top, 200)
                share = np.exp(-((v / dry.stribeck_speed[j]) ** 2))
                f = viscous[j] * v + sign * (
                    dry.coulomb[j] + (dry.stiction[j] - dry.coulomb[j]) * share
                )
                axes.plot(v, f, style, color=colour, lw=1.2, label=label if sign > 0.0 else None)

        limit = 1.3 * float(np.quantile(np.abs(lost[:, j]), 0.99))
        axes.set(
            title=name, xlabel="speed [rad/s]", ylabel="torque lost [N m]", ylim=(-limit, limit)
        )

    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=4,
        markerscale=6.0,
    )
    return figure
