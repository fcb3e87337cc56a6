"""`report.html` of an identification: parameters, measured and replayed values, residuals."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.calib.water.estimator import WaterFit
from uuv.calib.water.findings import Finding
from uuv.calib.water.logs import ATTITUDE, CHANNELS, UNITS
from uuv.sim.interfaces import page
from uuv.sim.interfaces.spatial import Array
from uuv.sim.runs.provenance import provenance_rows
from uuv.sim.runs.saving import write_whole
from uuv.water_identification.log_residuals import LogReplay, WaterResiduals

_ANGLES = ("roll [rad]", "pitch [rad]", "yaw [rad]")


def write_page(
    file: Path,
    title: str,
    identified: Sequence[Finding],
    sentences: Sequence[str],
    fit: WaterFit,
    residuals: WaterResiduals,
    options: Mapping[str, Any],
) -> None:
    """Write the report.

    Args:
        file: File to write.
        title: Heading.
        identified: Parameters of the vehicle.
        sentences: Sentences about what the logs do not identify.
        fit: The estimate.
        residuals: Residuals of the logs.
        options: Options of the command.
    """
    rows = [
        (
            finding.name,
            finding.unit,
            f"{finding.nominal:.4g}",
            f"{finding.value:.4g}",
            f"{finding.low:.4g} to {finding.high:.4g}",
            f"{100 * finding.told:.0f} %",
            finding.verdict,
        )
        for finding in identified
    ]

    columns = ("parameter", "unit", "prior", "estimate", "95 %", "variance removed", "")
    parts = [
        page.heading(title),
        page.section("Not identifiable from these logs", page.items(sentences)),
        page.section("Parameters", page.table(columns, rows, texts=(0, 1, 6))),
    ]

    states = residuals.states(fit.named.deviations, fit.named.local)
    about = (
        "Above: measured (dots) and replayed (lines), window by window. Below: replayed minus "
        "measured."
    )
    for log, rows_of_log in zip(residuals.logs, states, strict=True):
        for kind, drawn in _pictures(log, rows_of_log, fit.named.values):
            parts.append(page.figure(f"{log.log.name}: {kind}", about, drawn))

    parts.append(page.provenance(provenance_rows(options)))
    write_whole(file, page.page(title, parts))


def _pictures(
    log: LogReplay, rows: Array, values: Mapping[str, float]
) -> Iterator[tuple[str, Figure]]:
    for kind in log.kinds:
        time, measured, replayed, window = log.replayed(rows, kind, values)
        labels = (
            _ANGLES if kind == ATTITUDE else [f"{word} [{UNITS[kind]}]" for word in CHANNELS[kind]]
        )
        figure = Figure(figsize=(3.3 * len(labels), 4.0), layout="constrained")

        broken = np.where(np.diff(window, prepend=window[:1]) != 0)[0]
        for i, label in enumerate(labels):
            above = figure.add_subplot(2, len(labels), i + 1)
            above.plot(time, measured[:, i], ".", ms=1.5, color="0.5", label="measured")
            above.plot(
                np.insert(time, broken, np.nan),
                np.insert(replayed[:, i], broken, np.nan),
                color="tab:orange",
                lw=1.0,
            )

            above.set_title(label)
            below = figure.add_subplot(2, len(labels), len(labels) + i + 1)
            below.plot(time, replayed[:, i] - measured[:, i], ".", ms=1.5, color="tab:blue")
            below.axhline(0.0, color="0.6", lw=0.6)
            below.set_xlabel("time [s]")

        yield kind, figure
