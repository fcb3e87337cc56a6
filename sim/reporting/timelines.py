"""Interactive time series of one run or two, by Plotly: one time axis for all, with zoom."""

import html
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.io import to_html
from plotly.subplots import make_subplots

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.metrics import hull_motion
from uuv.sim.evaluation.surface.force_levels import ForceSteps, force_peak, tangential
from uuv.sim.evaluation.surface.tool_errors import path_error
from uuv.sim.interfaces.messages import CONTACT, WorkState
from uuv.sim.interfaces.palette import BLUE, CYCLE, FAINT, GREEN, ORANGE, PURPLE, SKY, VERMILION
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import RecordedSeries

ELEMENT = "timelines"  # id in the page
BINS = 1000  # of a line; in each its extremes are kept
_ROOM = 1.3  # span of a panel over the largest value that is judged
_ROW, _MARGIN = 210, 60  # [px] height of a panel, and what is above and below all
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, FAINT)
_DASHES = ("solid", "dot")  # first run, second run
_AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A named line: values (N,) at times (N,) [s]."""

    name: str
    time: Array
    value: Array
    colour: str


@dataclass(frozen=True, slots=True, eq=False)
class Panel:
    """Lines on one value axis, and bounds on them."""

    title: str
    lines: Sequence[Line]
    bounds: tuple[float, ...] = ()
    span: float | None = None  # shown at first to either side of zero; None: all


def timelines(runs: Mapping[str, RecordedSeries], bounds: Bounds | None = None) -> str:
    """HTML of the panels of one or two runs; empty if there is nothing to draw.

    Two runs are laid over each other with the start of the work at time 0, where both have worked.

    Args:
        runs: Recorded series by name of the run; those of the second are dotted.
        bounds: Bounds to draw; None: none.
    """
    start = _starts(list(runs.values()))
    drawn = {
        name: {panel.title: panel for panel in panels(recorded, bounds)}
        for name, recorded in runs.items()
    }

    titles = list(dict.fromkeys(title for series in drawn.values() for title in series))
    if not titles:
        return ""

    # Panels of all runs, one above the other.
    figure = make_subplots(rows=len(titles), shared_xaxes=True, vertical_spacing=0.16 / len(titles))
    for row, title in enumerate(titles, start=1):
        _draw(
            figure,
            row,
            {k: series[title] for k, series in enumerate(drawn.values()) if title in series},
            start,
        )

    # States shaded, first shown from the approach on.
    first = next(iter(runs.values()))
    _shade(figure, first, start[0])
    touched = next((event.time for event in first.events if event.state in CONTACT), None)
    if touched is not None:
        figure.update_xaxes(range=[touched - start[0], first.duration - start[0]])

    # Layout.
    since = "start of the work" if any(start) else "start of the run"
    figure.update_xaxes(title_text=f"time from the {since} [s]", row=len(titles), col=1)
    figure.update_xaxes(gridcolor="rgba(128,128,128,.22)", zeroline=False)
    figure.update_yaxes(gridcolor="rgba(128,128,128,.22)", zerolinecolor="rgba(128,128,128,.5)")
    figure.update_layout(
        height=_ROW * len(titles) + 2 * _MARGIN,
        margin={"l": 70, "r": 10, "t": _MARGIN, "b": _MARGIN},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        hovermode="x",
        modebar={"bgcolor": "rgba(0,0,0,0)"},
        font={"family": "system-ui, sans-serif", "size": 12, "color": FAINT},
        title={"text": _legend(list(runs)), "font": {"size": 13}} if len(runs) > 1 else None,
        **_legends(figure, len(titles)),
    )

    html = to_html(
        figure,
        full_html=False,
        include_plotlyjs=True,
        div_id=ELEMENT,
        config={"displaylogo": False, "responsive": True, "doubleClick": "autosize"},
    )
    return f"{html}<script>{_SHADES}</script>"


def panels(recorded: RecordedSeries, bounds: Bounds | None = None) -> Iterator[Panel]:
    """The panels that a run has data for."""
    contact = recorded.within(*CONTACT)

    if contact.any() and recorded["set_force"].scalar.any():
        time = recorded["contact_normal"].time[contact]
        force = {"set": "set_force", "felt": "felt_normal", "true": "contact_normal"}
        yield Panel(
            "normal force [N]",
            [
                Line(label, time, recorded[name].scalar[contact], colour)
                for (label, name), colour in zip(force.items(), (FAINT, ORANGE, BLUE), strict=True)
            ],
        )

        yield Panel(
            "tangential force [N]",
            [
                Line(
                    label, time, np.linalg.norm(tangential(recorded, name), axis=1)[contact], colour
                )
                for label, name, colour in (
                    ("felt", "felt_force", ORANGE),
                    ("true", "contact_force", BLUE),
                )
            ],
        )

        work = recorded.within(WorkState.WORK)
        if work.any():
            yield _force_error(recorded, work, _both(bounds and bounds.force_error_max))

    # Path.
    if (error := path_error(recorded)) is not None:
        judged = bounds is not None and np.isfinite(bounds.path_deviation)
        parts = (
            ("along", error.along),
            ("across", error.lateral),
            ("along the tool axis", error.normal),
        )
        yield Panel(
            "tip path error [mm]",
            [
                Line(name, error.time, 1e3 * component, _COLOURS[i])
                for i, (name, component) in enumerate(parts)
            ],
            _both(1e3 * bounds.path_deviation if bounds is not None and judged else None),
        )

    # Hull.
    if (motion := hull_motion(recorded)) is not None:
        time, displacement, turn = motion
        lines = [
            Line(axis, time, 1e3 * displacement[:, i], _COLOURS[i]) for i, axis in enumerate(_AXES)
        ]
        yield Panel("hull position error [mm]", lines)
        yield Panel("turn of the hull [deg]", [Line("turn", time, np.degrees(turn), BLUE)])

    # Drives and current.
    for name, title, scale in (
        ("thrust", "thrust [N]", 1.0),
        ("tau_drive", "joint torque [N m]", 1.0),
        ("q", "joint angle [deg]", float(np.degrees(1.0))),
        ("current", "current at the hull [m/s]", 1.0),
    ):
        if name in recorded and recorded[name].labels:
            series = recorded[name]
            yield Panel(
                title,
                [
                    Line(
                        label.replace("_", " "),
                        series.time,
                        scale * series.value[:, i],
                        CYCLE[i % len(CYCLE)],
                    )
                    for i, label in enumerate(series.labels)
                ],
            )

    yield from _arm_wrench(recorded)


def _force_error(recorded: RecordedSeries, work: np.ndarray, bounds: tuple[float, ...]) -> Panel:
    """Error of the force at the rows `work` (N,), judged or not; the axis fits the judged part."""
    steps = ForceSteps.of(recorded)
    settled = steps.settled[work]
    time = recorded["contact_normal"].time[work]
    error = recorded["contact_normal"].scalar[work] - recorded["set_force"].scalar[work]

    lines = [Line("true − set", time, np.where(settled, error, np.nan), BLUE)]
    if not settled.all():
        lines.append(Line("not judged", time, np.where(settled, np.nan, error), FAINT))

    # Peaks lie within the loop's steps.
    least, most = (recorded[name].scalar[work] for name in ("contact_least", "contact_most"))
    peak = force_peak(least, most, steps.force[work])[settled].max(initial=0.0)
    return Panel("force error [N]", lines, bounds, span=_ROOM * float(peak) or None)


def _arm_wrench(recorded: RecordedSeries) -> Iterator[Panel]:
    if "arm_wrench" not in recorded or "believed.arm_wrench_B" not in recorded:
        return
    true = recorded["arm_wrench"]
    believed = recorded["believed.arm_wrench_B"]

    for first, title in ((0, "arm's force on the hull [N]"), (3, "arm's moment on the hull [N m]")):
        lines = []
        for i, axis in enumerate(_AXES):
            lines.append(Line(axis, true.time, true.value[:, first + i], _COLOURS[i]))
            lines.append(
                Line(
                    f"{axis} believed", believed.time, believed.value[:, first + i], _COLOURS[i + 3]
                )
            )

        yield Panel(title, lines)


def _both(bound: float | None) -> tuple[float, ...]:
    return () if bound is None else (bound, -bound)


def _starts(runs: Sequence[RecordedSeries]) -> list[float]:
    """Time [s] drawn as 0 for each run: the start of the work if all of several runs worked, else
    0.
    """
    begun = [
        next((event.time for event in run.events if event.state is WorkState.WORK), None)
        for run in runs
    ]

    if len(runs) == 1 or None in begun:
        return [0.0] * len(runs)
    return [float(time) for time in begun if time is not None]


def _draw(
    figure: go.Figure, row: int, of_runs: Mapping[int, Panel], start: Sequence[float]
) -> None:
    """One panel with the lines of all runs, by their number, and its bounds."""
    in_legend: set[str] = set()
    legend = f"legend{row}" if row > 1 else "legend"

    for k, panel in of_runs.items():
        for line in panel.lines:
            time, thinned_values = thinned(line.time - start[k], line.value)
            figure.add_trace(
                go.Scatter(
                    x=time.astype(np.float32),
                    y=thinned_values.astype(np.float32),
                    name=html.escape(line.name),  # Plotly draws tags in a text
                    legend=legend,
                    legendgroup=f"{row} {html.escape(line.name)}",
                    showlegend=line.name not in in_legend,
                    mode="lines",
                    line={"color": line.colour, "width": 1.2, "dash": _DASHES[k % 2]},
                    hovertemplate="%{y:.3g}",
                ),
                row=row,
                col=1,
            )
            in_legend.add(line.name)

    panel = next(iter(of_runs.values()))
    figure.update_yaxes(title_text=panel.title, row=row, col=1)
    spans = [panel.span for panel in of_runs.values() if panel.span is not None]
    if spans:
        figure.update_yaxes(range=[-max(spans), max(spans)], row=row, col=1)
    for bound in panel.bounds:
        drawn: dict[str, Any] = {
            "line": {"color": VERMILION, "width": 1, "dash": "dash"},
            "row": row,
            "col": 1,
        }
        figure.add_hline(bound, **drawn)


def _legends(figure: go.Figure, count: int) -> dict[str, dict[str, object]]:
    """A legend above each panel, at its right."""
    legends: dict[str, dict[str, object]] = {}
    for row in range(1, count + 1):
        top = figure.layout["yaxis" if row == 1 else f"yaxis{row}"].domain[1]
        position = {"x": 1.0, "xanchor": "right", "y": top, "yanchor": "bottom", "orientation": "h"}
        legends["legend" if row == 1 else f"legend{row}"] = {
            **position,
            "bgcolor": "rgba(0,0,0,0)",
            "font": {"size": 11},
        }

    return legends


def _shade(figure: go.Figure, recorded: RecordedSeries, start: float) -> None:
    """Shade the work state of the first run, and name the states that are long enough."""
    ends = [event.time for event in recorded.events[1:]] + [recorded.duration]

    for event, end in zip(recorded.events, ends, strict=True):
        if event.state is WorkState.WORK:
            shade: dict[str, Any] = {
                "fillcolor": SKY,
                "opacity": 0.12,
                "line_width": 0,
                "row": "all",
                "col": 1,
            }
            figure.add_vrect(event.time - start, end - start, **shade)

        if event.state is WorkState.WORK or end - event.time > 0.05 * recorded.duration:
            figure.add_annotation(
                x=0.5 * (event.time + end) - start,
                y=1.0,
                yref="y domain",
                yanchor="bottom",
                text=event.state.value,
                showarrow=False,
                font={"size": 10},
                xanchor="center",
                yshift=26,  # [px] above the legend
            )


def _legend(names: Sequence[str]) -> str:
    return html.escape(f"solid: {names[0]}; dotted: {', '.join(names[1:])}")


def thinned(time: Array, value: Array) -> tuple[Array, Array]:
    """Least and greatest value of each bin, which keeps every peak and a small file."""
    size = -(-len(time) // BINS)
    if size <= 2:
        return time, value
    count = -(-len(time) // size)

    bins = np.pad(value, (0, count * size - len(value)), mode="edge").reshape(count, size)
    least = np.where(np.isnan(bins), np.inf, bins).argmin(axis=1)
    most = np.where(np.isnan(bins), -np.inf, bins).argmax(axis=1)
    extremes = np.sort(np.stack([least, most], axis=1), axis=1)
    rows = np.minimum((extremes + size * np.arange(count)[:, None]).ravel(), len(value) - 1)

    return time[rows], value[rows]


# Text colours follow the reader's light or dark screen; paper is light.
_SHADES = f"""
(() => {{
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const paint = (on) => Plotly.relayout("{ELEMENT}", {{"font.color": on ? "#ccc" : "#333"}});
  dark.addEventListener("change", () => paint(dark.matches));
  addEventListener("beforeprint", () => paint(false));
  addEventListener("afterprint", () => paint(dark.matches));
  paint(dark.matches);
}})();
"""
