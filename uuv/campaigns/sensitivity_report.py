"""Page of sensitivities: parameters that explain the failures and each figure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.campaigns.sensitivity import (
    FIRST,
    RESAMPLES,
    Factor,
    ReasonShift,
    Sensitivity,
    factors_of,
    fewest_runs,
    sensitivity,
    shifts,
)
from uuv.experiment import Table
from uuv.sim.evaluation.intervals import LEVEL
from uuv.sim.interfaces.palette import BLUE, FAINT, INK, WIDTH
from uuv.sim.interfaces.spatial import Array

MISSED, WORST = "missed", "worst ratio to a bound"  # responses that rank the parameters
_ORIGIN = "perturbations."  # left out of labels
_CHANCE = 1.0 - LEVEL  # share of the parameters without effect that are beyond the null level
_SMALLEST = 1e-4  # smallest p that is shown as a number


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SensitivityReport:
    """Sensitivities of the responses of a table of runs; empty if the runs do not allow any."""

    found: Mapping[str, Sensitivity]  # sensitivities by response
    factors: Sequence[Factor]
    shifts: Sequence[ReasonShift]  # shifts of the parameters that explain the failures best
    runs: int
    needed: int

    @classmethod
    def of(
        cls,
        draws: Sequence[Mapping[str, Any]],
        responses: Mapping[str, Array],
        reasons: Sequence[Sequence[str]],
    ) -> "SensitivityReport":
        """The report of a table of runs.

        Args:
            draws: Drawn values by name, of each run.
            responses: (runs,) values by response. The first response with a sensitivity ranks the
                parameters.
            reasons: Reasons why each run failed; a run may have several or none.
        """
        factors = factors_of(draws)
        by_response = {}

        for name, response in responses.items():
            measured = sensitivity(factors, response, np.random.default_rng(len(draws)))
            if measured is not None:
                by_response[name] = measured

        # The first parameters of the ranking, compared with the reasons of the failures.
        first: list[Factor] = []
        if by_response:
            first = [factors[i] for i in next(iter(by_response.values())).ranking[:FIRST]]
        moved = shifts(first, reasons)

        return cls(
            found=by_response,
            factors=factors,
            shifts=moved,
            runs=len(draws),
            needed=fewest_runs(factors),
        )

    @property
    def metrics(self) -> dict[str, Any]:
        """Content for metrics.json."""
        return {
            "responses": {name: response.as_metrics() for name, response in self.found.items()},
            "reasons": [asdict(shift) for shift in self.shifts],
        }

    @property
    def lines(self) -> list[str]:
        """Sentence that explains a missing result."""
        if self.found or not self.factors:
            return []
        why = (
            f"needs {self.needed} runs, there are {self.runs}"
            if self.runs < self.needed
            else "no figure varies"
        )
        return [f"no sensitivity to the {len(self.factors)} drawn parameters: {why}"]

    def tables(self) -> Iterator[Table]:
        """Tables of the ranking, and of the reasons of failures against it."""
        if not self.found:
            return

        name, main = next(iter(self.found.items()))
        second = self.found.get(MISSED) if name != MISSED else None

        yield Table(
            title=f"Most influential parameters: {name}",
            columns=(
                "parameter",
                "coefficient",
                "95 % interval",
                "p",
                "place",
                *(("with missed",) if second else ()),
            ),
            rows=[
                (
                    label(main.names[i]),
                    f"{main.coefficient[i]:+.2f}",
                    f"{main.low[i]:+.2f} to {main.high[i]:+.2f}",
                    shown_p(main.p[i]),
                    f"{main.place[i, 0]} to {main.place[i, 1]}",
                    *((f"{second.coefficient[i]:+.2f}",) if second else ()),
                )
                for i in main.ranking[:FIRST]
            ],
            # Share of the variance that they explain.
            caption=f"Partial rank correlation over {main.runs} runs, {len(main.names)} "
            f"parameters. These {min(FIRST, len(main.names))} explain "
            f"{main.explained_by_first:.0%} of the variance of the ranks, all "
            f"{main.explained:.0%}, adjusted for their number {main.adjusted:.0%}.",
        )

        if self.shifts:
            yield self._reasons()

    def _reasons(self) -> Table:
        parameters = list(dict.fromkeys(shift.parameter for shift in self.shifts))
        rows = []

        for reason in dict.fromkeys(shift.reason for shift in self.shifts):
            by_parameter = {
                shift.parameter: shift for shift in self.shifts if shift.reason == reason
            }
            cells = [
                f"{shift.median_rank:.2f} (p {shown_p(shift.p)})"
                if (shift := by_parameter.get(parameter))
                else ""
                for parameter in parameters
            ]
            rows.append((reason, str(max(shift.runs for shift in by_parameter.values())), *cells))

        return Table(
            title="Reasons of the failures against these parameters",
            columns=("reason", "runs", *map(label, parameters)),
            rows=rows,
            caption="Median rank of the parameter among the runs with this reason: 0 the lowest "
            "of all runs, 1 the highest; p: Mann-Whitney test against all other runs.",
        )

    def pictures(self) -> Iterator[tuple[str, str, Figure]]:
        """Bars of the responses that separate kept from missed runs, and the matrix of all
        responses.
        """
        ranked = {
            name: response for name, response in self.found.items() if name in (WORST, MISSED)
        }
        if ranked:
            yield (
                "Influence of each parameter",
                "Partial rank correlation with 95 % interval: percentiles of a bootstrap of "
                f"{RESAMPLES} samples. Grey band: 95 % range of a parameter without effect; of "
                f"{len(self.factors)} such parameters, {_CHANCE * len(self.factors):.1f} are "
                "expected outside it.",
                bar_figure(ranked),
            )

        if self.found:
            yield (
                "Sensitivity of all figures",
                "Partial rank correlation of each figure with each parameter; bold: outside the "
                "95 % range of a parameter without effect.",
                matrix_figure(self.found),
            )


def label(name: str) -> str:
    """Name of a parameter without the table that all perturbations share."""
    return name.removeprefix(_ORIGIN)


def shown_p(p: float) -> str:
    """A probability as text."""
    return f"{p:.2g}" if p >= _SMALLEST else f"< {_SMALLEST:g}"


def bar_figure(by_response: Mapping[str, Sensitivity]) -> Figure:
    """Bars with intervals, in a panel for each response; parameters in the order of the first
    panel.
    """
    main = next(iter(by_response.values()))
    order = main.ranking[::-1]
    positions = np.arange(len(order))
    figure = Figure(figsize=(WIDTH, 1.0 + 0.27 * len(order)), layout="constrained")
    panels = figure.subplots(1, len(by_response), sharey=True, squeeze=False)[0]

    for axes, (name, response) in zip(panels, by_response.items(), strict=True):
        coefficients = response.coefficient[order]
        beyond = np.abs(coefficients) > response.null[order]

        # Band without an effect, and the coefficient with its interval.
        axes.barh(
            positions,
            2.0 * response.null[order],
            left=-response.null[order],
            height=1.0,
            color="#eeeeee",
        )
        axes.barh(
            positions,
            coefficients,
            height=0.62,
            color=[BLUE if is_beyond else "#a9c7de" for is_beyond in beyond],
        )
        axes.hlines(positions, response.low[order], response.high[order], color=INK, linewidth=1.1)

        axes.axvline(0.0, color=FAINT, linewidth=0.8)
        axes.set_xlim(-1.0, 1.0)
        axes.set_ylim(-0.5, len(order) - 0.5)
        axes.set_title(
            f"{name} (R² {response.explained:.2f}, adjusted {response.adjusted:.2f})", fontsize=9
        )
        axes.set_xlabel("partial rank correlation", fontsize=9)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(labelsize=8, left=False)

    panels[0].set_yticks(positions, [label(main.names[i]) for i in order])
    return figure


def matrix_figure(by_response: Mapping[str, Sensitivity]) -> Figure:
    """Matrix of the coefficients: responses by parameters."""
    names = next(iter(by_response.values())).names
    matrix = np.array([response.coefficient for response in by_response.values()])
    beyond = np.array(
        [np.abs(response.coefficient) > response.null for response in by_response.values()]
    )

    figure = Figure(figsize=(WIDTH, 2.2 + 0.34 * len(by_response)), layout="constrained")
    axes = figure.subplots()
    axes.imshow(matrix, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")

    # Coefficients in the cells; bold if beyond the null level.
    for (i, j), coefficient in np.ndenumerate(matrix):
        strong = "white" if abs(coefficient) > 0.6 else INK
        weight = "bold" if beyond[i, j] else "normal"
        color = strong if beyond[i, j] else FAINT
        axes.text(
            j,
            i,
            f"{coefficient:.2f}",
            ha="center",
            va="center",
            fontsize=7,
            color=color,
            weight=weight,
        )

    axes.set_xticks(range(len(names)), list(map(label, names)), rotation=40, ha="right", fontsize=8)
    axes.set_yticks(range(len(by_response)), list(by_response), fontsize=8)
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return figure
