"""Calibration of an elastic arm touched under payloads, with and without its compliances.

The simulated arm is the UR10e of [Yukhimets 2023] with links of their published masses and joints
that bend; three points are touched 42 times each, payloads in turn. Errors are those of moves of
the flange under each of three payloads.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.calibration.simulated_arm import FLANGE_POINTS, POINTS, nominal_arm, touched_arm
from uuv.arm_identification.simulated_touches import LOOKING_DOWN, TOOLS
from uuv.calib import Calibration, Loads, identify
from uuv.calib.simulation import HAND_NOISE, Sag, read_by_encoders, true_joints
from uuv.calib.verification import compare, flange_poses
from uuv.components.deck_calibration import touched
from uuv.experiment import Page, column, experiment, stat
from uuv.models.arms.serial_arm import SerialArm

LINKS = (7.4, 13.1, 4.0, 2.1, 2.0, 0.6)  # [kg] of the UR10e [UniversalRobots DH]
# [N m/rad] of the true joints, of the order of such gears
STIFFNESS = (4e4, 4e4, 3e4, 1e4, 1e4, 1e4)
COMPLIANCE = 1.0 / np.array(STIFFNESS)  # [rad/(N m)]
HELD = (0.0, 0.0, 0.1)  # [m] centre of mass of a payload in the flange
LOADED_TOUCHES = 42  # of each point, shared evenly among the payloads
PAYLOADS = ("0", "5", "10", "0 10", "0 5 10")  # [kg] during the touches
JUDGED = (0.0, 5.0, 10.0)  # [kg] payloads under which moves of the flange are judged


@dataclass(frozen=True, kw_only=True)
class LoadCase:
    """Calibration of one elastic arm."""

    payloads: str
    """Payloads during the touches [kg]."""
    model: str
    """What is identified: rigid, the table alone; elastic, compliances of the joints too."""
    seed: int
    """Seed of errors and touches."""


@dataclass(frozen=True, kw_only=True)
class LoadRow:
    """Errors of moves of the flange, and standard deviations of the compliances."""

    cost: float = column("J", "mm²", digits=0, factor=1e6)
    nominal: Mapping[str, float] = column("nominal", "mm", digits=3, factor=1e3, by="moved payload")
    identified: Mapping[str, float] = column(
        "identified", "mm", digits=3, factor=1e3, by="moved payload"
    )
    relative_sigma: Mapping[str, float] = column(
        "sigma over the true value", "%", factor=100.0, by="compliance"
    )
    hidden: Mapping[str, bool] = column("not determined", by="compliance")


@experiment(
    "calibration_loads",
    seeds=10,
    vary={"payloads": PAYLOADS, "model": ("rigid", "elastic")},
    paired=True,
    quick={"runs": 1},
)
def calibration_loads(case: LoadCase) -> LoadRow:
    """Calibrates one arm."""
    truth = touched_arm(case.seed)[1].arm
    payloads = [float(word) for word in case.payloads.split()]
    masses = [np.resize(payloads, LOADED_TOUCHES)] * POINTS

    # touches of the bent arm, read by encoders that do not see the sag
    rng = np.random.default_rng([case.seed, 1])
    true, _ = touched(
        truth,
        np.array(TOOLS["off-axis"]),
        truth.limits,
        rng,
        points=POINTS,
        touches=LOADED_TOUCHES,
        noise=HAND_NOISE,
        way=LOOKING_DOWN,
    )
    series = read_by_encoders(truth, true, sag=Sag(compliance=COMPLIANCE, loads=_loads(masses)))

    # with compliances or without
    elastic = case.model == "elastic"
    calibration = identify(series, nominal_arm(), loads=_loads(masses) if elastic else None)
    sigma = dict(zip(calibration.names, calibration.sigma, strict=True))
    hidden = {name for group in calibration.rank_free.hidden for name in group.names}
    names = [f"c{k}" for k in range(1, truth.n + 1)] if elastic else []

    errors = {f"{payload:g} kg": _errors(truth, calibration, payload) for payload in JUDGED}
    return LoadRow(
        cost=calibration.cost,
        nominal={payload: error for payload, (error, _) in errors.items()},
        identified={payload: error for payload, (_, error) in errors.items()},
        relative_sigma={name: sigma[name] / c for name, c in zip(names, COMPLIANCE, strict=False)},
        hidden={name: name in hidden for name in names},
    )


def _loads(payload: Any) -> Loads:
    """Links, and a payload [kg], or one for each touch."""
    return Loads(link_masses=LINKS, payload_mass=payload, payload_center=HELD)


def _errors(truth: SerialArm, calibration: Calibration, payload: float) -> tuple[float, float]:
    """RMS errors [m] of moves of the flange under a payload [kg], nominal and identified."""
    origin = np.zeros(3)
    q = flange_poses(nominal_arm(), np.random.default_rng(0), FLANGE_POINTS, limits=truth.limits)
    bent = true_joints(truth, q, sag=Sag(compliance=COMPLIANCE, loads=_loads(payload)))
    models = {
        "nominal": nominal_arm().tips(q, origin),
        "identified": calibration.arm.tips(calibration.deflected(q, payload), origin),
    }
    clouds = compare(truth.tips(bent, origin), models)
    return clouds["nominal"].rms, clouds["identified"].rms


calibration_loads.page = (
    Page()
    .table(
        "An elastic arm touched under payloads: error of moves of the flange under 0, 5, 10 kg, "
        "medians",
        by=("payloads", "model"),
        across="moved payload",
        columns=[stat("median", "nominal", "nominal"), stat("median", "identified", "identified")],
    )
    .table("Cost", by=("payloads", "model"), columns=[stat("median", "cost")])
    .table(
        "Standard deviation of the compliances over the true value, medians [%]",
        by="payloads",
        across="compliance",
        columns=[stat("median", "relative_sigma")],
    )
    .table(
        "Arms whose loads do not show the compliance; the prior holds it",
        by="payloads",
        across="compliance",
        columns=[stat("count", "hidden")],
    )
)

if __name__ == "__main__":
    run_scenario(calibration_loads.main)
