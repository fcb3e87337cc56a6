"""Error of the tip force estimated from joint torques: one row of estimator, torque source and arm,
and the table.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from uuv import models
from uuv.controllers.estimation.force_from_torques import (
    tip_force,
    tip_force_closed_form,
    tip_wrench,
)
from uuv.experiment import Row, Summary, Table
from uuv.models.arms import dh_geometry, published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicles import uuv_puma
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams

KEPT = 0.3  # share of white noise that passes the 12 ms filter of the felt force
LEAST = 1e-3  # [N m] least standard deviation of any torque: a reading of zero is not exact
FORCE = 90.0  # [N] largest component of the drawn forces
WEIGHT = 50.0  # [N] weight at the tip, which the sensors read besides the contact
MOMENT = 3.0  # [N m] largest component of the drawn moments
KNOWN = 0.8  # share of the dry friction that identification removes
# Torque limits of the joints [N m]: the vehicles' assets; Universal Robots and Franka Emika,
# technical data.
ALPHA = "reach_alpha_5"
LIMITS = {
    "default": (150, 200, 120, 60, 30, 15),
    "ur10e": (330, 330, 150, 56, 56, 56),
    "panda": (87, 87, 87, 87, 12, 12, 12),
    ALPHA: (10, 10, 10, 0.6),
}
SIZE = {ALPHA: 0.1}  # [-] of forces, moments, weight and bias, over those of the others
# sliding friction of the default vehicle, share of the limit; stiction is 1.3 times that
SLIDING = 0.04


FORMS = ("closed form", "least squares", "weighted", "force and moment")
# of generator, reading (n,) and sliding friction (n,)
Errors = Callable[[np.random.Generator, Array, Array], Array]
# assumed standard deviation (n,) [N m], of reading and sliding friction
Doubt = Callable[[Array, Array], Array]


@dataclass(frozen=True)
class ForceCase:
    """One estimator with one torque source on one arm; a case of the study."""

    arm: str  # of LIMITS
    source: str  # of `sources`
    form: str  # of FORMS
    seed: int
    runs: int  # number of postures
    noise: float  # of the torque sensors, share of the reading
    bias: float  # [N m] of the torque sensors, uniform in +-


def cases(seed: int, runs: int, noise: float, bias: float) -> Iterator[ForceCase]:
    """Yields every row of the table; the arguments are the fields of `ForceCase`."""
    for arm in LIMITS:
        for source in SOURCES:
            for form in FORMS:
                # The closed form holds for arms of its kind alone.
                if form != "closed form" or arm == "default":
                    yield ForceCase(arm, source, form, seed, runs, noise, bias)


SOURCES = (
    "sensor, tared",
    "sensor, bias",
    "observer, friction known to 20 %",
    "observer, friction not known",
    "observer, joints at rest",
)


def sources(case: ForceCase) -> dict[str, tuple[Errors, Doubt]]:
    """Error model of each torque source, and the standard deviations that the estimator assumes."""
    bias = case.bias * SIZE.get(case.arm, 1.0)

    def of_sensors(bias: float) -> Callable[[Array, Array], Array]:
        return lambda reading, _: np.hypot(
            KEPT * case.noise * np.abs(reading) + LEAST, bias / np.sqrt(3.0)
        )

    def of_friction(share: float) -> Callable[[Array, Array], Array]:
        return lambda _, sliding: share * sliding

    return {
        "sensor, tared": (sensors(case, 0.0), of_sensors(0.0)),
        "sensor, bias": (sensors(case, bias), of_sensors(bias)),
        "observer, friction known to 20 %": (motors(1.0 - KNOWN, False), of_friction(1.0 - KNOWN)),
        "observer, friction not known": (motors(1.0, False), of_friction(1.0)),
        "observer, joints at rest": (motors(1.0, True), of_friction(1.3 / np.sqrt(3.0))),
    }


def arm_of(name: str) -> SerialArm:
    """An arm of LIMITS."""
    if name == "default":
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


def sensors(case: ForceCase, bias: float) -> Errors:
    """Error model of torque sensors: a function of generator, reading (n,) [N m] and sliding
    friction (n,) [N m].

    Args:
        case: Tells the noise.
        bias: [N m] uniform in +-; 0 after a tare.
    """

    def errors(rng: np.random.Generator, reading: Array, _: Array) -> Array:
        return KEPT * case.noise * np.abs(reading) * rng.standard_normal(
            len(reading)
        ) + rng.uniform(-bias, bias, len(reading))

    return errors


def motors(unknown: float, held: bool) -> Errors:
    """Error model of motor currents without torque sensors: unknown gear friction appears as
    external torque.

    Args:
        unknown: Unknown share of the sliding friction.
        held: The joints are at rest, where stiction acts in either direction.

    Returns:
        A function of generator, reading (n,) [N m] and sliding friction (n,) [N m].
    """

    def errors(rng: np.random.Generator, reading: Array, sliding: Array) -> Array:
        if held:
            return 1.3 * sliding * rng.uniform(-1.0, 1.0, len(reading))
        return unknown * sliding * rng.choice([-1.0, 1.0], len(reading))

    return errors


def run(case: ForceCase) -> Row:
    """Force errors over random postures.

    Returns:
        Median and RMS error [N] over the nine tenths of the postures far from singular; RMS error
        [N] there along each axis of the tool, and the standard deviation [N] stated for it; median
        error [N] over the tenth nearest to singular; normalised estimation error squared over 3.
    """
    arm, size = arm_of(case.arm), SIZE.get(case.arm, 1.0)
    wrong, doubt = sources(case)[case.source]
    streams = Streams(case.seed, len(case.form), arm.n)
    sliding = SLIDING * np.array(LIMITS[case.arm], dtype=np.float64)
    low, high = np.maximum(arm.limits[:, 0], -np.pi), np.minimum(arm.limits[:, 1], np.pi)

    rows = []
    for _ in range(case.runs):
        q = streams["posture"].uniform(low, high)
        if case.form == "closed form":
            q[4:] = 0.0  # the closed form assumes it

        J = jacobian(arm, q)
        wrench = streams["wrench"].uniform(-1.0, 1.0, 6) * np.repeat(
            [size * FORCE, size * MOMENT if case.form == "force and moment" else 0.0], 3
        )
        tau_e = J.T @ wrench

        # Torques that the sensors read: those of a weight at the tip, less those of the wrench.
        weight = arm.joint_frames(q)[-1][:3, :3].T @ [0.0, 0.0, -size * WEIGHT]
        reading = J[:3].T @ weight - tau_e
        felt = tau_e + wrong(streams["torque errors"], reading, sliding)

        sigma, weakest = doubt(reading, sliding), float(np.linalg.svd(J[:3])[1][-1])
        covariance: Array | None = None

        if case.form == "closed form":
            if min(abs(np.sin(q[3])), abs(np.linalg.norm(arm.joint_frames(q)[-1][:2, 3]))) < 1e-3:
                continue

            # G of [Konoplin 2022]: x along link 4, z across it in the arm's plane, y out of the
            # plane.
            elevation = q[1] + q[2] + q[3]
            c, s = np.cos(elevation), np.sin(elevation)
            out = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
            ahead = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
            up = np.array([0.0, 0.0, 1.0])
            axes = np.column_stack([c * ahead + s * up, out, -s * ahead + c * up])

            force = (
                arm.joint_frames(q)[-1][:3, :3].T
                @ axes
                @ tip_force_closed_form(felt, q, (0.6, 0.5, 0.22))
            )
        elif case.form == "force and moment":
            found = tip_wrench(felt, J, sigma, moment_prior=size * MOMENT)
            force, covariance = found.wrench[:3], found.covariance[:3, :3]
        elif case.form == "least squares":  # without the deviations of the torques it states none
            force = tip_force(felt, J[:3], np.ones(arm.n))[0]
        else:
            force, covariance = tip_force(felt, J[:3], sigma)

        error = force - wrench[:3]
        squared, stated = 0.0, np.full(3, np.nan)
        if covariance is not None:
            squared, stated = float(error @ np.linalg.solve(covariance, error)), np.diag(covariance)

        rows.append((weakest, float(error @ error), squared, *error**2, *stated))

    table = np.array(rows)
    near = table[:, 0] <= np.quantile(table[:, 0], 0.1)

    return {
        "arm": case.arm,
        "source": case.source,
        "form": case.form,
        "median_n": np.sqrt(np.median(table[~near, 1])),
        "rms_n": np.sqrt(np.mean(table[~near, 1])),
        "axes_rms_n": np.sqrt(np.mean(table[~near, 3:6], axis=0)).tolist(),
        "axes_stated_n": None
        if np.isnan(table[:, 6:]).any()
        else np.sqrt(np.mean(table[~near, 6:9], axis=0)).tolist(),
        "near_singular_median_n": np.sqrt(np.median(table[near, 1])),
        "nees_share": np.mean(table[:, 2]) / 3.0 if table[:, 2].any() else None,
    }


def summarise(rows: list[Row]) -> Summary:
    """The table of all rows."""
    cells = [
        (
            row["arm"],
            row["source"],
            row["form"],
            f"{row['median_n']:.2f} {row['rms_n']:9.2f}",
            _by_axis(row),
            f"{row['near_singular_median_n']:.1f}",
            "" if row["nees_share"] is None else f"{row['nees_share']:.2f}",
        )
        for row in rows
    ]

    table = Table(
        title=f"Error of the felt force [N], forces to {FORCE:g} N a component, "
        f"{SIZE[ALPHA] * FORCE:g} N on {ALPHA}",
        columns=(
            "arm",
            "torques",
            "form",
            "median, RMS",
            "x, y, z (stated)",
            "median near singular",
            "NEES / 3",
        ),
        rows=cells,
        labels=3,
    )

    return Summary(metrics={"rows": rows}, tables=[table])


def _by_axis(row: Row) -> str:
    """Error along each axis of the tool, and in brackets what was stated for it."""
    errors, stated = row["axes_rms_n"], row["axes_stated_n"]
    if stated is None:
        return ", ".join(f"{error:.2f}" for error in errors)
    return ", ".join(
        f"{error:.2f} ({sigma:.2f})" for error, sigma in zip(errors, stated, strict=True)
    )
