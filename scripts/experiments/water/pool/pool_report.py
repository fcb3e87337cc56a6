"""Tables and pictures of the pool validation."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from experiments.water.pool.pool_vehicle import NOMINAL, PARAMETERS, pool_model
from experiments.water.pool.replay import TrialScore, replay
from experiments.water.pool.trials import PoolTrial
from experiments.water.pool.validation import Validation, medians
from uuv.calib.water.named_fit import values_of
from uuv.experiment import Table
from uuv.sim.interfaces.extras import wanted

_SHOWN = 6  # trials in the picture
_DEGREES = float(np.degrees(1.0))


def score_table(title: str, of: Mapping[str, Sequence[TrialScore]]) -> Table:
    """Medians and the worst trial of several sets of scores."""
    rows = []
    for name, scored in of.items():
        m = medians(scored)
        worst = max(scored, key=lambda each: max(each.rms))

        rows.append(
            [
                name,
                f"{m['roll_rms_deg']:.2f}, {m['pitch_rms_deg']:.2f}",
                f"{_DEGREES * worst.rms[0]:.1f}, {_DEGREES * worst.rms[1]:.1f} ({worst.name})",
                f"{m['roll_correlation']:.3f}, {m['pitch_correlation']:.3f}",
                f"{m['roll_amplitude']:.2f}, {m['pitch_amplitude']:.2f}",
                f"{m['rise_error_m']:.2f}",
                f"{m['drift_error_m']:.2f}",
            ]
        )

    return Table(
        title=title,
        columns=(
            "model",
            "RMS of roll, pitch [deg]",
            "worst trial [deg]",
            "correlation",
            "amplitude ratio",
            "error of the rise [m]",
            "of the drift [m]",
        ),
        rows=rows,
    )


def trial_table(found: Sequence[TrialScore]) -> Table:
    """Each trial."""
    return Table(
        title="Each trial",
        columns=(
            "trial",
            "RMS roll, pitch [deg]",
            "correlation",
            "amplitude ratio",
            "rise measured, error [m]",
        ),
        rows=[
            [
                score.name,
                f"{_DEGREES * score.rms[0]:.2f}, {_DEGREES * score.rms[1]:.2f}",
                f"{score.correlation[0]:.2f}, {score.correlation[1]:.2f}",
                f"{score.amplitude[0]:.2f}, {score.amplitude[1]:.2f}",
                f"{score.rise:.2f}, {score.rise_error:+.2f}",
            ]
            for score in found
        ],
    )


def buoyancy_table(buoyancies: Mapping[str, float]) -> Table:
    """Net buoyancy of each trajectory number."""
    return Table(
        title="Net buoyancy that the rises of each trajectory number speak for",
        columns=tuple(buoyancies),
        rows=[[f"{value:.2f} N" for value in buoyancies.values()]],
    )


def parameter_table(result: Validation) -> Table:
    """Each parameter with its nominal value, its interval, and what the trials tell of it."""
    rows = []
    for i, parameter in enumerate(PARAMETERS):
        low, high = result.interval(i)
        rows.append(
            [
                parameter.name,
                parameter.unit,
                f"{parameter.nominal:.3g}",
                f"{parameter.value(float(result.fit.deviations[i])):.3g}",
                f"{low:.3g} to {high:.3g}" if np.isfinite(low) else "-",
                f"{result.fit.told[i]:.0%}",
            ]
        )

    return Table(
        title=f"Parameters of the {result.hull} hull from the trials",
        columns=(
            "parameter",
            "unit",
            "nominal",
            "fitted",
            "95 %, by trajectory numbers",
            "told by the trials",
        ),
        rows=rows,
    )


def numbers_of(result: Validation) -> dict[str, Any]:
    """Everything, for a file."""
    return {
        "hull": result.hull,
        "parameters": {
            parameter.name: {
                "unit": parameter.unit,
                "nominal": parameter.nominal,
                "fitted": parameter.value(float(result.fit.deviations[i])),
                "interval": list(result.interval(i)) if np.isfinite(result.spread[i]) else None,
                "told": float(result.fit.told[i]),
            }
            for i, parameter in enumerate(PARAMETERS)
        },
        "untuned": {
            "medians": medians(result.untuned),
            "trials": [asdict(score) for score in result.untuned],
        },
        "left_out": {
            "medians": medians(result.left_out),
            "trials": [asdict(score) for score in result.left_out],
        },
    }


def draw(file: Path, result: Validation, trials: Sequence[PoolTrial]) -> None:
    """Roll, pitch and rise of some trials: measured, fitted and untuned."""
    with wanted():
        from matplotlib.figure import Figure

    # From the best to the worst trial, at even steps of rank.
    order = sorted(result.left_out, key=lambda each: max(each.rms))
    chosen = [
        order[i].name
        for i in np.linspace(0, len(order) - 1, min(_SHOWN, len(order))).round().astype(int)
    ]

    by_name = {trial.name: trial for trial in trials}
    fitted = values_of(PARAMETERS, result.fit.deviations)
    models = {
        "fitted": (pool_model(result.hull, fitted), fitted, "C0"),
        "untuned": (pool_model(result.hull, NOMINAL), NOMINAL, "C1"),
    }

    figure = Figure(figsize=(10.0, 2.0 * len(chosen)), layout="constrained")
    axes = figure.subplots(len(chosen), 3, squeeze=False, sharex=False)

    for row, name in zip(axes, chosen, strict=True):
        trial = by_name[name]
        time = trial.times - trial.times[0]
        measured = (*_DEGREES * trial.attitude[:, :2].T, trial.position[:, 2])
        for panel, line in zip(row, measured, strict=True):
            panel.plot(time, line, color="0.2", linewidth=2.5, alpha=0.6, label="measured")

        for label, (model, values, color) in models.items():
            motion = replay(model, trial, values)
            lines = (*_DEGREES * motion.attitude[:, :2].T, motion.position[:, 2])
            for panel, line, real in zip(row, lines, measured, strict=True):
                panel.plot(time, line, color=color, linewidth=1.0, label=label)
                middle, half = float(np.mean(real)), 1.6 * float(np.ptp(real)) + 0.2
                panel.set_ylim(middle - half, middle + half)

        row[0].set_ylabel(name)
        for panel in row:
            panel.grid(alpha=0.3)

    for panel, title in zip(axes[0], ("roll [deg]", "pitch [deg]", "rise [m]"), strict=True):
        panel.set_title(title)
    axes[0][0].legend(fontsize="small", loc="upper right")

    for panel in axes[-1]:
        panel.set_xlabel("time [s]")

    figure.savefig(file, dpi=110)
