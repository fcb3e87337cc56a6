"""Study: error of the tip force estimated from joint torques, for each estimator, torque source and three arms.

`./uvw run scripts/studies/tip_force.py` draws postures and forces, corrupts the torques with errors of sensors and
gears, and prints one table. It covers statics only; errors due to water and motion show in the closed loop.
"""

from scenarios.start import parse, run_scenario  # isort: skip

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from rich.console import Console
from rich.table import Table

from controllers.estimation.force_from_torques import tip_force, tip_force_closed_form, tip_wrench
from models.arms import published_arms
from models.arms.serial_arm import SerialArm
from models.vehicles import uuv_puma
from sim.interfaces.spatial import Array

KEPT = 0.3  # share of white noise that passes the 12 ms filter of the felt force
LEAST = 1e-3  # [N m] least standard deviation of any torque: a reading of zero is not exact
WEIGHT = 50.0  # [N] weight at the tip, which the sensors read besides the contact
MOMENT = 3.0  # [N m] largest component of the drawn moments
KNOWN = 0.8  # share of the dry friction that identification removes
# Torque limits of the joints [N m]: the default vehicle's asset; Universal Robots and Franka Emika, technical data.
LIMITS = {
    "default": (150, 200, 120, 60, 30, 15),
    "ur10e": (330, 330, 150, 56, 56, 56),
    "panda": (87, 87, 87, 87, 12, 12, 12),
}
SLIDING = 0.04  # sliding friction of the default vehicle, share of the limit; stiction is 1.3 times that


@dataclass(kw_only=True)
class Options:
    """Errors of the estimated tip force."""

    seed: int = 0
    count: int = 3000
    """Number of postures drawn for each row."""
    noise: float = 0.01
    """Noise of the torque sensors, share of the reading."""
    bias: float = 0.5
    """Bias of the torque sensors [N m], uniform in +-, where no tare removes it."""


def default_arm() -> SerialArm:
    """The default vehicle's arm."""
    return replace(SerialArm.from_dh(uuv_puma.DH), limits=np.tile([-2.0, 2.0], (6, 1)))


def jacobian(arm: SerialArm, q: Array) -> Array:
    """Geometric Jacobian (6, n) of the tip in tip axes, linear rows above angular rows."""
    frames = arm.joint_frames(q)
    R, p = frames[-1][:3, :3], frames[-1][:3, 3]
    axes = frames[:-1, :3, 2]
    linear = np.cross(axes, p - frames[:-1, :3, 3])
    return np.vstack([R.T @ linear.T, R.T @ axes.T])


def sensors(options: Options, tared: bool) -> Callable[[np.random.Generator, Array, Array], Array]:
    """Error model of torque sensors: a function of generator, reading (n,) [N m] and sliding friction (n,) [N m]."""

    def errors(rng: np.random.Generator, reading: Array, _: Array) -> Array:
        bias = 0.0 if tared else rng.uniform(-options.bias, options.bias, len(reading))
        return KEPT * options.noise * np.abs(reading) * rng.standard_normal(len(reading)) + bias

    return errors


def motors(unknown: float, held: bool) -> Callable[[np.random.Generator, Array, Array], Array]:
    """Error model of motor currents without torque sensors: unknown gear friction appears as external torque.

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


def line(
    arm: SerialArm, name: str, form: str, wrong: Callable, options: Options, doubt: Callable[[Array, Array], Array]
) -> tuple[str, str, str]:
    """One row of the table: force errors over random postures.

    Args:
        arm: Kinematics.
        name: Name of the arm in LIMITS.
        form: Estimator: "closed form", "least squares", "weighted" or "force and moment".
        wrong: Error model of the torques, from `sensors` or `motors`.
        options: Options of the study.
        doubt: Standard deviation (n,) [N m] of the torques that the estimator assumes.

    Returns:
        Median and RMS error [N] over the nine tenths of the postures far from singular; median error [N] over the tenth
        nearest to singular; normalised estimation error squared over 3.
    """
    rng = np.random.default_rng([options.seed, len(form), arm.n])
    sliding = SLIDING * np.array(LIMITS[name], dtype=np.float64)
    low, high = np.maximum(arm.limits[:, 0], -np.pi), np.minimum(arm.limits[:, 1], np.pi)
    rows = []
    for _ in range(options.count):
        q = rng.uniform(low, high)
        if form == "closed form":
            q[4:] = 0.0  # the closed form assumes it
        J = jacobian(arm, q)
        wrench = rng.uniform(-1.0, 1.0, 6) * np.repeat([90.0, MOMENT if form == "force and moment" else 0.0], 3)
        tau_e = J.T @ wrench
        weight = arm.joint_frames(q)[-1][:3, :3].T @ [0.0, 0.0, -WEIGHT]
        reading = J[:3].T @ weight - tau_e
        felt = tau_e + wrong(rng, reading, sliding)
        sigma, weakest = doubt(reading, sliding), float(np.linalg.svd(J[:3])[1][-1])
        covariance: Array | None = None
        if form == "closed form":
            if min(abs(np.sin(q[3])), abs(np.linalg.norm(arm.joint_frames(q)[-1][:2, 3]))) < 1e-3:
                continue
            # G of [Konoplin 2022]: x along link 4, z across it in the arm's plane, y out of the plane.
            elevation = q[1] + q[2] + q[3]
            c, s = np.cos(elevation), np.sin(elevation)
            out = np.array([-np.sin(q[0]), np.cos(q[0]), 0.0])
            ahead = np.array([np.cos(q[0]), np.sin(q[0]), 0.0])
            up = np.array([0.0, 0.0, 1.0])
            axes = np.column_stack([c * ahead + s * up, out, -s * ahead + c * up])
            force = arm.joint_frames(q)[-1][:3, :3].T @ axes @ tip_force_closed_form(felt, q, (0.6, 0.5, 0.22))
        elif form == "force and moment":
            found = tip_wrench(felt, J, sigma, moment_prior=MOMENT)
            force, covariance = found.wrench[:3], found.covariance[:3, :3]
        else:
            force, covariance = tip_force(felt, J[:3], np.ones(arm.n) if form == "least squares" else sigma)
        error = force - wrench[:3]
        squared = 0.0
        if covariance is not None and form != "least squares":
            squared = float(error @ np.linalg.solve(covariance, error))
        rows.append((weakest, float(error @ error), squared))
    table = np.array(rows)
    near = table[:, 0] <= np.quantile(table[:, 0], 0.1)
    rms, worst = np.sqrt(np.median(table[~near, 1])), np.sqrt(np.median(table[near, 1]))
    squared = f"{np.mean(table[:, 2]) / 3.0:.2f}" if table[:, 2].any() else ""
    return f"{rms:.2f} {np.sqrt(np.mean(table[~near, 1])):9.2f}", f"{worst:.1f}", squared


def main() -> int:
    """Runs the study, prints its table and returns the exit code."""
    options = parse(Options)

    def of_sensors(bias: float) -> Callable[[Array, Array], Array]:
        return lambda reading, _: np.hypot(KEPT * options.noise * np.abs(reading) + LEAST, bias / np.sqrt(3.0))

    def of_friction(share: float) -> Callable[[Array, Array], Array]:
        return lambda _, sliding: share * sliding

    sources = (
        ("sensor, tared", sensors(options, True), of_sensors(0.0)),
        ("sensor, bias", sensors(options, False), of_sensors(options.bias)),
        ("observer, friction known to 20 %", motors(1.0 - KNOWN, False), of_friction(1.0 - KNOWN)),
        ("observer, friction not known", motors(1.0, False), of_friction(1.0)),
        ("observer, joints at rest", motors(1.0, True), of_friction(1.3 / np.sqrt(3.0))),
    )
    table = Table(title=f"Error of the felt force [N], forces to 90 N a component, {options.count} postures")
    for column in ("arm", "torques", "form"):
        table.add_column(column)
    for column in ("median, RMS", "median near singular", "NEES / 3"):
        table.add_column(column, justify="right")
    for name, arm in (("default", default_arm()), *((name, published_arms.load(name)) for name in ("ur10e", "panda"))):
        for source, wrong, doubt in sources:
            for form in ("closed form", "least squares", "weighted", "force and moment"):
                if form == "closed form" and name != "default":
                    continue
                table.add_row(name, source, form, *line(arm, name, form, wrong, options, doubt))
    Console().print(table)
    return 0


if __name__ == "__main__":
    run_scenario(main)
