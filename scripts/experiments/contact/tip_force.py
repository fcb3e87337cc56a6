"""Error of the tip force estimated from joint torques, by estimator, source of torques and arm.

Postures and forces are drawn, up to 90 N a component, a tenth of that on Reach Alpha 5; the torques
get errors of sensors or gears. Medians and RMS are over the nine tenths of the postures that are
farthest from singular ones, by axis of the tool, z along it; the standard deviation is the one that
the estimator states. Sensors: 1 % noise, filtered, and a bias where no tare removes it; observers
take motor currents, and gear friction for external torque. This is statics: errors due to water and
motion show in the closed loop.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uuv import models
from uuv.controllers.estimation.force_from_torques import (
    tip_force,
    tip_force_closed_form,
    tip_wrench,
)
from uuv.experiment import Page, column, experiment
from uuv.experiment.options import at_least
from uuv.models.arms import dh_geometry, published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicles import uuv_puma
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number
from uuv.sim.interfaces.streams import Streams

KEPT = 0.3  # share of white noise that passes the 12 ms filter of the estimated force
LEAST = 1e-3  # [N m] least standard deviation of any torque: a reading of zero is not exact
FORCE = 90.0  # [N] largest component of the drawn forces
WEIGHT = 50.0  # [N] weight at the tip, which the sensors read besides the contact
MOMENT = 3.0  # [N m] largest component of the drawn moments
KNOWN = 0.8  # share of the dry friction that identification removes
SLIDING = 0.04  # [-] sliding friction of the default vehicle over the torque limit
STICTION = 1.3  # [-] over sliding friction
NEAREST = 0.1  # share of the postures that are near singular
LEAST_POSTURES = 20  # two of them near singular
# Torque limits of the joints [N m]: the vehicles' assets; Universal Robots and Franka Emika,
# technical data.
ALPHA = "reach_alpha_5"
DEFAULT = "default"
LIMITS = {
    DEFAULT: (150, 200, 120, 60, 30, 15),
    "ur10e": (330, 330, 150, 56, 56, 56),
    "panda": (87, 87, 87, 87, 12, 12, 12),
    ALPHA: (10, 10, 10, 0.6),
}
SIZE = {ALPHA: 0.1}  # [-] of forces, moments, weight and bias, over those of the others
LINKS = (0.6, 0.5, 0.22)  # [m] of the default arm, for the closed form

CLOSED, SQUARES, WEIGHTED, WRENCH = "closed form", "least squares", "weighted", "force and moment"
FORMS = (CLOSED, SQUARES, WEIGHTED, WRENCH)
SOURCES = (
    "sensor, tared",
    "sensor, bias",
    "observer, friction known to 20 %",
    "observer, friction not known",
    "observer, joints at rest",
)
# of generator, reading (n,) and sliding friction (n,)
Errors = Callable[[np.random.Generator, Array, Array], Array]
# assumed standard deviation (n,) [N m], of reading and sliding friction
Doubt = Callable[[Array, Array], Array]


@dataclass(frozen=True, kw_only=True)
class ForceCase:
    """One estimator with one source of torques on one arm."""

    arm: str
    """Name of the arm."""
    source: str
    """Where the torques come from."""
    form: str
    """Estimator; the closed form is of the default arm alone."""
    postures: int = 3000
    """Number of postures."""
    noise: float = 0.01
    """Noise of the torque sensors, share of the reading."""
    bias: float = 0.5
    """Bias of the torque sensors [N m], uniform in +-, where no tare removes it; a tenth on the
    small arm.
    """
    seed: int = 0
    """Seed of postures, forces and errors."""

    def __post_init__(self) -> None:
        at_least(self, postures=LEAST_POSTURES, seed=0)
        for name in ("noise", "bias"):
            finite_number(getattr(self, name), f"--{name}", least=0.0)


@dataclass(frozen=True, kw_only=True)
class ForceRow:
    """Errors of the estimated force, and what was stated of them."""

    median: float = column("median", "N", digits=2)
    rms: float = column("RMS", "N", digits=2)
    axes_rms: Sequence[float] = column("RMS along x, y, z", "N", digits=2)
    axes_stated: Sequence[float] | None = column("stated", "N", digits=2, default=None)
    near_singular: float = column("median near singular", "N", digits=1)
    nees: float | None = column("NEES per degree of freedom", digits=2, default=None)


def cases(case: ForceCase) -> Iterator[ForceCase]:
    """The case, if its estimator is one for its arm."""
    if case.form != CLOSED or case.arm == DEFAULT:
        yield case


@experiment(
    "tip_force",
    vary={"arm": tuple(LIMITS), "source": SOURCES, "form": FORMS},
    cases=cases,
    quick={"arm": (ALPHA,)},
)
def tip_force_errors(case: ForceCase) -> ForceRow:
    """Estimates the forces of random postures.

    Raises:
        ConfigurationError: The closed form has a solution at fewer than LEAST_POSTURES of them.
    """
    arm, size = arm_of(case.arm), SIZE.get(case.arm, 1.0)
    errors, doubt = error_model(case)
    # the same for all forms: they are compared on the same postures, forces and errors
    streams = Streams(case.seed, arm.n)
    sliding = SLIDING * np.array(LIMITS[case.arm], dtype=np.float64)
    low, high = np.maximum(arm.limits[:, 0], -np.pi), np.minimum(arm.limits[:, 1], np.pi)
    moment = size * MOMENT if case.form == WRENCH else 0.0

    records = []
    for _ in range(case.postures):
        q = streams["posture"].uniform(low, high)
        if case.form == CLOSED:
            q[4:] = 0.0  # the closed form assumes it

        J = jacobian(arm, q)
        wrench = streams["wrench"].uniform(-1.0, 1.0, 6) * np.repeat([size * FORCE, moment], 3)
        tau_e = J.T @ wrench

        # Torques that the sensors read: those of a weight at the tip, less those of the wrench.
        weight = arm.joint_frames(q)[-1][:3, :3].T @ [0.0, 0.0, -size * WEIGHT]
        reading = J[:3].T @ weight - tau_e
        torques = tau_e + errors(streams["torque errors"], reading, sliding)

        if case.form == CLOSED:
            if _is_singular(arm, q):
                continue
            force, covariance = _by_closed_form(arm, q, torques), None
        else:
            force, covariance = _estimate(case.form, torques, J, doubt(reading, sliding), size)

        # What the estimator states of its error, if anything.
        error, squared, stated = force - wrench[:3], 0.0, np.full(3, np.nan)
        if covariance is not None:
            squared = float(error @ np.linalg.solve(covariance, error))
            stated = np.diag(covariance)

        weakest = float(np.linalg.svd(J[:3])[1][-1])
        records.append((weakest, float(error @ error), squared, *error**2, *stated))

    if len(records) < LEAST_POSTURES:
        raise ConfigurationError(
            f"--postures: the closed form needs a solution at {LEAST_POSTURES} of them, it has one "
            f"at {len(records)} of {case.postures}"
        )
    return _row(np.array(records))


def _row(records: Array) -> ForceRow:
    """Row of records (N, 9) of one posture each: least singular value of the Jacobian, squared
    error, squared error over the covariance, squared errors along the axes, variances stated.
    """
    near = records[:, 0] <= np.quantile(records[:, 0], NEAREST)
    errors, squared = records[:, 1], records[:, 2]
    axes = np.sqrt(np.mean(records[~near, 3:], axis=0)).reshape(2, 3)

    return ForceRow(
        median=float(np.sqrt(np.median(errors[~near]))),
        rms=float(np.sqrt(np.mean(errors[~near]))),
        axes_rms=axes[0].tolist(),
        axes_stated=None if np.isnan(axes[1]).any() else axes[1].tolist(),
        near_singular=float(np.sqrt(np.median(errors[near]))),
        nees=float(np.mean(squared)) / 3.0 if squared.any() else None,
    )


def _estimate(
    form: str, torques: Array, J: Array, sigma: Array, size: float
) -> tuple[Array, Array | None]:
    """Force (3,) [N] in tip axes, and its covariance (3, 3), None: none is stated."""
    if form == WRENCH:
        estimate = tip_wrench(torques, J, sigma, moment_prior=size * MOMENT)
        return estimate.wrench[:3], estimate.covariance[:3, :3]
    if form == SQUARES:  # without the deviations of the torques it states none
        return tip_force(torques, J[:3], np.ones(J.shape[1]))[0], None
    return tip_force(torques, J[:3], sigma)


def _is_singular(arm: SerialArm, q: Array) -> bool:
    """Whether the closed form has no solution at `q`: a straight elbow, or the tip on the axis of
    joint 1.
    """
    aside = np.linalg.norm(arm.joint_frames(q)[-1][:2, 3])
    return bool(min(abs(np.sin(q[3])), abs(aside)) < 1e-3)


def _by_closed_form(arm: SerialArm, q: Array, torques: Array) -> Array:
    """Force (3,) [N] in tip axes by [Konoplin 2022, eq. 5]."""
    # Its frame G: x along link 4, z across it in the arm's plane, y out of the plane.
    elevation = q[1] + q[2] + q[3]
    c, s = np.cos(elevation), np.sin(elevation)
    out = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
    ahead = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    axes = np.column_stack([c * ahead + s * up, out, -s * ahead + c * up])

    R = arm.joint_frames(q)[-1][:3, :3]
    return R.T @ axes @ tip_force_closed_form(torques, q, LINKS)


def error_model(case: ForceCase) -> tuple[Errors, Doubt]:
    """Errors of a case's source of torques, and the standard deviations that the estimator assumes
    of them.
    """
    bias = case.bias * SIZE.get(case.arm, 1.0)

    def of_sensors(bias: float) -> Doubt:
        return lambda reading, _: np.hypot(
            KEPT * case.noise * np.abs(reading) + LEAST, bias / np.sqrt(3.0)
        )

    def of_friction(share: float) -> Doubt:
        return lambda _, sliding: share * sliding

    models_of = (
        (sensors(case.noise, 0.0), of_sensors(0.0)),
        (sensors(case.noise, bias), of_sensors(bias)),
        (motors(1.0 - KNOWN, False), of_friction(1.0 - KNOWN)),
        (motors(1.0, False), of_friction(1.0)),
        (motors(1.0, True), of_friction(STICTION / np.sqrt(3.0))),
    )
    return models_of[SOURCES.index(case.source)]


def sensors(noise: float, bias: float) -> Errors:
    """Errors of torque sensors.

    Args:
        noise: Share of the reading.
        bias: [N m] uniform in +-; 0 after a tare.
    """

    def errors(rng: np.random.Generator, reading: Array, _: Array) -> Array:
        white = KEPT * noise * np.abs(reading) * rng.standard_normal(len(reading))
        return white + rng.uniform(-bias, bias, len(reading))

    return errors


def motors(unknown: float, at_rest: bool) -> Errors:
    """Errors of motor currents without torque sensors: unknown gear friction appears as external
    torque.

    Args:
        unknown: Unknown share of the sliding friction.
        at_rest: The joints are at rest, where stiction acts in either direction.
    """

    def errors(rng: np.random.Generator, reading: Array, sliding: Array) -> Array:
        if at_rest:
            return STICTION * sliding * rng.uniform(-1.0, 1.0, len(reading))
        return unknown * sliding * rng.choice([-1.0, 1.0], len(reading))

    return errors


def arm_of(name: str) -> SerialArm:
    """An arm of LIMITS."""
    if name == DEFAULT:
        return replace(SerialArm.from_dh(uuv_puma.DH), limits=np.tile([-2.0, 2.0], (6, 1)))
    if name == ALPHA:
        return dh_geometry.read(models.load(ALPHA).compile(), ARM_BASE_BODY, TIP_SITE)
    return published_arms.load(name)


def jacobian(arm: SerialArm, q: Array) -> Array:
    """Geometric Jacobian (6, n) of the tip in tip axes, linear rows above angular rows."""
    frames = arm.joint_frames(q)
    R, p = frames[-1][:3, :3], frames[-1][:3, 3]
    axes = frames[:-1, :3, 2]
    linear = np.cross(axes, p - frames[:-1, :3, 3])
    return np.vstack([R.T @ linear.T, R.T @ axes.T])


tip_force_errors.page = (
    Page()
    .table(
        "Error of the force [N] by weighted least squares, median",
        by="source",
        across="arm",
        columns=["median"],
        where=lambda row: row["form"] == WEIGHTED,
    )
    .table(
        "Error of the force",
        by=("arm", "source", "form"),
        columns=["median", "rms", "axes_rms", "axes_stated", "near_singular", "nees"],
    )
)

if __name__ == "__main__":
    run_scenario(tip_force_errors.main)
