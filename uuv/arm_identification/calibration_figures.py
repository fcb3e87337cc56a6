"""Figures of a calibration, which are printed and reported, and the contents of metrics.json."""

from typing import Any

import numpy as np

from uuv.arm_identification.calibration_case import CalibrationCase
from uuv.arm_identification.calibration_outcome import CalibrationOutcome
from uuv.arm_identification.calibration_remarks import remarks
from uuv.calib import report, verification
from uuv.calib.identification import Calibration
from uuv.sim.interfaces.spatial import Array


def figures_of_merit(case: CalibrationCase, outcome: CalibrationOutcome) -> list[tuple[str, str]]:
    """Names and formatted values for the terminal and the report."""
    calibration = outcome.calibration
    rank = outcome.calibration.rank
    touches = sum(len(residuals) for residuals in calibration.residuals)
    out = [
        (
            "touches, points, outliers",
            f"{touches}, {len(calibration.residuals)}, {len(calibration.outliers)}",
        ),
        (
            "touches of reduced weight",
            str(sum(int(((w > 0.0) & (w < 1.0)).sum()) for w in calibration.weights)),
        ),
        (
            "J before, after [mm²]",
            f"{1e6 * calibration.cost_nominal:.4g}, {1e6 * calibration.cost:.4g}",
        ),
        ("touch noise, each axis [mm]", f"{1e3 * calibration.noise:.4f}"),
        ("identified directions", f"{rank.rank} of {rank.total}"),
        ("scale", _scale(case, outcome)),
    ]
    if case.loads is not None:
        out.append(("compliances [µrad/(N m)]", _compliances(calibration)))

    # Simulated tracker, where the truth is known.
    for label, clouds in (
        ("tracker RMS", outcome.clouds),
        ("tracker RMS, without hull motion", outcome.uncorrected),
    ):
        if clouds:
            before, after = clouds["nominal"].rms, clouds["identified"].rms
            out.append(
                (f"{label}: nominal, identified [mm]", f"{1e3 * before:.4f}, {1e3 * after:.4f}")
            )
            if "controller" in clouds:
                out.append(
                    (f"{label}: a maker's own table [mm]", f"{1e3 * clouds['controller'].rms:.4f}")
                )
            out.append((f"{label}: ratio", f"{before / max(after, 1e-12):.2f}"))

    if outcome.tips is not None:
        before, after = (1e3 * np.sqrt((errors**2).mean()) for errors in outcome.tips)
        out.append(("tip in the base, RMS: nominal, identified [mm]", f"{before:.3f}, {after:.3f}"))

    out += _held_out_rows(outcome)
    if case.session is not None:
        session = case.session
        out += [
            ("duration [s], nests missed", f"{session.simulated_s:.0f}, {session.missed}"),
            ("seat of the pin, true spread [mm]", f"{1e3 * session.tip_spread:.4f}"),
            ("hull, largest true motion between touches [mm]", f"{1e3 * session.hull_motion:.3f}"),
        ]
    return out


def _held_out_rows(outcome: CalibrationOutcome) -> list[tuple[str, str]]:
    """Names and formatted values of touches that were held out."""
    if not outcome.held_out:
        return []

    rms_mm = 1e3 * np.array(list(outcome.held_out.values()))
    median = "{:.3f}, {:.3f}".format(*np.median(rms_mm, axis=0))
    out = [
        (f"held out, {name}: nominal, identified [mm]", f"{before:.3f}, {after:.3f}")
        for name, (before, after) in zip(outcome.held_out, rms_mm, strict=True)
    ]
    out.append(("held out, median: nominal, identified [mm]", median))

    # As the fit predicts them.
    out += [
        (f"held out, {name}: predicted, at most (95 %) [mm]", f"{1e3 * rms:.3f}, {1e3 * bound:.3f}")
        for name, (rms, bound) in outcome.foretold.items()
    ]
    if outcome.covered is not None and outcome.half_width is not None:
        interval = f"{100.0 * outcome.covered:.1f} %, ± {1e3 * outcome.half_width:.3f}"
        out.append(("held out, within the 95 % interval; its median [mm]", interval))
    return out


def most_changed(fit: Calibration, count: int = 5) -> list[tuple[str, str, str, str]]:
    """Name, change, half 95 % interval and unit of parameters whose interval excludes nominal.

    The most significant `count` of them; empty if there are none.
    """
    names, changes = fit.names, fit.estimate.changes
    half = fit.quantile() * fit.sigma
    arm = [
        i
        for i, group in enumerate(fit.estimate.parameters.groups)
        if group != "tcp" and abs(changes[i]) > half[i]
    ]

    rows = []
    for i in sorted(arm, key=lambda i: -abs(changes[i]) / half[i])[:count]:
        factor, unit = report.shown(fit.estimate.parameters.units[i])
        rows.append((names[i], f"{factor * changes[i]:+.4f}", f"± {factor * half[i]:.4f}", unit))
    return rows


def _compliances(calibration: Calibration) -> str:
    """Compliance of each joint and half of its 95 % interval; a dash if it is not determined."""
    half = dict(zip(calibration.names, calibration.quantile() * calibration.sigma, strict=True))
    hidden = {name for group in calibration.rank_free.hidden for name in group.names}

    cells = []
    for k, compliance in enumerate(calibration.compliance, start=1):
        known = f"c{k}" in half and f"c{k}" not in hidden
        cells.append(f"{1e6 * compliance:.1f} ± {1e6 * half[f'c{k}']:.1f}" if known else "-")
    return ", ".join(cells)


def _scale(case: CalibrationCase, outcome: CalibrationOutcome) -> str:
    """Accuracy of the arm's scale, which only a known distance determines."""
    if not case.distances:
        return "not identifiable without a known distance"
    longest = max(case.distances, key=lambda distance: distance[2])

    calibration = outcome.calibration
    i, j, length, deviation = longest
    ends = calibration.noise / np.sqrt(
        min(len(calibration.residuals[i]), len(calibration.residuals[j]))
    )
    ppm = 1e6 * float(np.hypot(deviation, np.sqrt(2.0) * ends)) / length
    return (
        f"from {len(case.distances)} known distances, the longest {length:.3f} m: ± {ppm:.0f} ppm"
    )


def metrics(
    case: CalibrationCase, outcome: CalibrationOutcome, ok: bool, seed: int
) -> dict[str, Any]:
    """Contents of metrics.json: SI units, null where a figure does not exist.

    Args:
        case: Input.
        outcome: Result.
        ok: The result is accepted.
        seed: Seed of the run.
    """
    calibration = outcome.calibration
    rank = outcome.calibration.rank
    clouds = outcome.clouds
    session = case.session
    return {
        "title": case.title,
        "seed": seed,
        "accepted": ok,
        "untold": list(outcome.examined.untold),
        "remarks": remarks(case, outcome),
        # The touches, and the fit to them.
        "touches": _touch_metrics(case, calibration),
        "fit": _fit_metrics(case, calibration),
        # Parameters that the touches determine.
        "rank": {
            "identified": rank.rank,
            "of": rank.total,
            "hidden": [
                {"count": g.count, "names": list(g.names), "reason": g.reason} for g in rank.hidden
            ],
        },
        # Comparison with the truth, and with touches held out.
        "tracker": {name: clouds[name].rms for name in ("nominal", "identified")}
        if clouds
        else None,
        "pairs": _pairs(outcome),
        "tracker_stages": _stages(clouds) if clouds else None,
        "tracker_uncorrected_m": outcome.uncorrected["identified"].rms
        if outcome.uncorrected
        else None,
        "held_out_m": {name: _held_out(outcome, name) for name in outcome.held_out} or None,
        # Touching by contact, and the result.
        "contact": None
        if session is None
        else {
            "simulated_s": session.simulated_s,
            "missed": session.missed,
            "seat_spread_m": session.tip_spread,
            "hull_motion_m": session.hull_motion,
        },
        "parameters": {
            name: {"value": value, "change": change, "sigma": sigma, "unit": unit}
            for name, value, change, sigma, unit in zip(
                calibration.names,
                calibration.estimate.values.tolist(),
                calibration.estimate.changes.tolist(),
                calibration.sigma.tolist(),
                calibration.estimate.parameters.units,
                strict=True,
            )
        },
    }


def _held_out(outcome: CalibrationOutcome, name: str) -> dict[str, float | None]:
    """RMS distances of the held-out touches of a point, measured and predicted; None for one."""
    nominal, identified = outcome.held_out[name]
    predicted, bound = outcome.foretold.get(name, (None, None))
    measured = {"nominal": nominal, "identified": identified}
    return {**measured, "predicted": predicted, "at_most": bound}


def _touch_metrics(case: CalibrationCase, calibration: Calibration) -> dict[str, Any]:
    """Figures of the touches: number, weight and noise."""
    return {
        "count": sum(len(residuals) for residuals in calibration.residuals),
        "points": len(calibration.residuals),
        "reduced": sum(
            int(((weights > 0.0) & (weights < 1.0)).sum()) for weights in calibration.weights
        ),
        "left_out": len(calibration.outliers),
        "sha256": case.touches.sha256,
        "noise_m": float(calibration.noise),
    }


def _fit_metrics(case: CalibrationCase, calibration: Calibration) -> dict[str, Any]:
    """Figures of the fit: cost and convergence."""
    return {
        "cost_nominal_m2": float(calibration.cost_nominal),
        "cost_m2": float(calibration.cost),
        "steps": len(calibration.history) - 1,
        "converged": bool(calibration.converged),
        "compliance_rad_nm": calibration.compliance.tolist() if case.loads is not None else None,
        "warnings": list(calibration.warnings),
    }


def _pairs(outcome: CalibrationOutcome) -> dict[str, float]:
    """Distances between the touches of a point, in all pairs [Yukhimets 2023, fig. 4]."""
    calibration = outcome.calibration
    series = list(outcome.series)
    before = verification.pair_distances(
        [calibration.nominal.tips(q, calibration.nominal_tcp) for q in series]
    )
    after = verification.pair_distances(calibration.touched_tips(series))

    return {
        "count": len(before),
        "nominal_mean_m": float(before.mean()),
        "identified_mean_m": float(after.mean()),
        "ten_times_closer": float(np.mean(before > 10.0 * after)),
    }


def _stages(clouds: dict[str, verification.Cloud]) -> dict[str, Any]:
    """Stages of the comparison of flange points with the tracker's [Yukhimets 2023, fig. 5 to
    8].
    """
    tracker = clouds["tracker"]

    def stage(name: str) -> dict[str, float]:
        cloud = clouds[name]
        return {
            "raw_m": _rms(cloud.raw - tracker.raw),
            "centred_m": _rms(cloud.centred - tracker.centred),
            "aligned_m": cloud.rms,
            "most_m": float(cloud.deviations.max()),
        }

    closer = clouds["identified"].deviations < clouds["nominal"].deviations
    stages = {name: stage(name) for name in clouds if name != "tracker"}
    return {"points": len(tracker.raw), "closer": int(closer.sum()), **stages}


def _rms(offsets: Array) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))
