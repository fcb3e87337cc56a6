"""Calibration study: effects of real arms, loads, wild touches, touches of real arms; row of a
case, and tables.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.arm_identification.calibration_case import CalibrationCase, TrueArm, nominal
from uuv.arm_identification.calibration_outcome import solve
from uuv.arm_identification.simulated_touches import LOOKING_DOWN, TOOLS, RealEffects, simulated
from uuv.calib import Calibration, Loads, identify
from uuv.calib.simulation import HAND_NOISE, Sag, read_by_encoders, true_joints
from uuv.calib.touch_files import read_touches
from uuv.calib.verification import compare, flange_poses
from uuv.components.deck_calibration import touched
from uuv.experiment import Row, Summary, Table
from uuv.models.arms import published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

ARM, POINTS, TOUCHES = "ur10e", 3, 21  # as in [Yukhimets 2023]
PUBLISHED_RATIO = 0.6715 / 0.2262  # nominal over identified, by the tracker [Yukhimets 2023]
# Amplitudes of gears: half of the peak-to-peak accuracy of component sets of sizes 25 and 14
# [HarmonicDrive CSF]. Seating: real touches scatter about their socket by 0.08 to 0.2 mm along each
# axis, all errors together (`--real`).
EFFECTS = {
    "ideal, off-axis pin": RealEffects(),
    "ideal, straight pin": RealEffects(),
    "gears 0.15 mrad": RealEffects(gears=1.5e-4),
    "gears 0.22 mrad": RealEffects(gears=2.2e-4),
    "gears 1 mrad": RealEffects(gears=1e-3),
    "seating 0.05 mm": RealEffects(seating=5e-5),
    "seating 0.2 mm": RealEffects(seating=2e-4),
    "sag 2 µrad/(N m)": RealEffects(compliance=2e-6),
    "sag 5 µrad/(N m)": RealEffects(compliance=5e-6),
    "sag 25 µrad/(N m)": RealEffects(compliance=2.5e-5),
    "gears 0.15 mrad, seating 0.1 mm, sag 2 µrad/(N m)": RealEffects(
        gears=1.5e-4, seating=1e-4, compliance=2e-6
    ),
}
LINKS = (7.4, 13.1, 4.0, 2.1, 2.0, 0.6)  # [kg] of the UR10e [UniversalRobots DH]
# [N m/rad] of the true joints, of the order of such gears
STIFFNESS = (4e4, 4e4, 3e4, 1e4, 1e4, 1e4)
HELD = (0.0, 0.0, 0.1)  # [m] centre of mass of a payload in the flange
LOADED_TOUCHES = 42  # of each point, shared evenly among the payloads
# [kg] payloads during the touches
LEVELS = ((0.0,), (5.0,), (10.0,), (0.0, 10.0), (0.0, 5.0, 10.0))
JUDGED = (0.0, 5.0, 10.0)  # [kg] payloads at which moves of the flange are judged
WILD = (0, 3, 6, 9, 12)  # touches that are displaced
DISPLACED = (0.05, 0.005)  # [rad] standard deviation of the displacement of every joint
_JUDGES = 40  # flange points at which arms are compared


@dataclass(frozen=True)
class EffectCase:
    """Calibration of a simulated arm with one of EFFECTS."""

    effect: str
    seed: int


@dataclass(frozen=True)
class LoadCase:
    """Calibration of a simulated elastic arm, touched under payloads."""

    payloads: tuple[float, ...]  # [kg]
    elastic: bool  # compliances are identified
    seed: int


@dataclass(frozen=True)
class WildCase:
    """Calibration from touches of which some are displaced in all joints."""

    count: int
    size: float  # [rad]
    seed: int


@dataclass(frozen=True)
class RealCase:
    """Calibration of a real arm from the touches at one position, or at all others."""

    folder: str  # one folder a position, in it one CSV file a socket
    position: str
    alone: bool  # trained on that position and tested on the others; else the other way round
    arm: str
    length: float  # [m] between the sockets of a position
    aside: tuple[str, ...] = ()  # positions that are not tested


AnyCase = EffectCase | LoadCase | WildCase | RealCase


def simulated_cases(seed: int, runs: int, wild_runs: int) -> Iterator[AnyCase]:
    """Yields the simulated cases: effects and loads with `runs` seeds, wild touches with
    `wild_runs`.
    """
    for k in range(runs):
        yield from (EffectCase(effect, seed + k) for effect in EFFECTS)
    for k in range(wild_runs):
        yield from (
            LoadCase(levels, elastic, seed + k) for levels in LEVELS for elastic in (False, True)
        )
        yield from (WildCase(count, size, seed + k) for size in DISPLACED for count in WILD)


def real_cases(folder: Path, arm: str, length: float, aside: tuple[str, ...]) -> Iterator[AnyCase]:
    """Yields the cases of one real arm: each position left out, and each alone.

    Raises:
        ConfigurationError: There are fewer than two positions.
    """
    positions = (
        [each.name for each in sorted(folder.iterdir()) if each.is_dir()] if folder.is_dir() else []
    )
    if len(positions) < 2:
        raise ConfigurationError(
            f"--real {folder}: at least two folders of touches are needed, got {len(positions)}"
        )
    for alone in (False, True):
        for position in positions:
            yield RealCase(str(folder), position, alone, arm, length, aside)


def run(case: AnyCase) -> Row:
    """Row of a case, with its kind."""
    if isinstance(case, EffectCase):
        return {"kind": "effect", **_effect(case)}
    if isinstance(case, LoadCase):
        return {"kind": "load", **_load(case)}
    if isinstance(case, WildCase):
        return {"kind": "wild", **_wild(case)}
    return {"kind": "real", **_real(case)}


def _drawn(effect: str, seed: int) -> CalibrationCase:
    return simulated(
        nominal(ARM, Path(), None, None),
        points=POINTS,
        touches=TOUCHES,
        noise=HAND_NOISE,
        pin="straight" if "straight" in effect else "off-axis",
        known=False,
        errors=seed,
        rng=np.random.default_rng(seed),
        real=EFFECTS[effect],
    )


def _effect(case: EffectCase) -> Row:
    drawn = _drawn(case.effect, case.seed)
    outcome = solve(drawn, free=(), prior={}, method="map")
    found, truth = outcome.calibration, drawn.truth
    assert truth is not None
    before, after = outcome.clouds["nominal"].rms, outcome.clouds["identified"].rms
    inside = _inside(found, truth)
    return {
        "effect": case.effect,
        "nominal_m": before,
        "identified_m": after,
        "ratio": before / after,
        "cost_m2": found.cost,
        "rank": found.rank.rank,
        "covered": sum(inside),
        "combinations": len(inside),
        "reduced": _reduced(found),
    }


def _inside(found: Calibration, truth: TrueArm) -> list[bool]:
    """Of each seen combination, whether its 95 % interval holds the truth."""
    full = np.concatenate([truth.arm.table.ravel(), truth.tcp, np.zeros(truth.arm.n)])
    estimate = found.estimate
    change = full[estimate.parameters.index] - (estimate.values - estimate.changes)
    values = [
        (float(seen.weights / found.rank_free.scales @ change), seen.interval)
        for seen in found.combinations()
    ]
    return [low <= value <= high for value, (low, high) in values]


def _reduced(found: Calibration) -> int:
    return sum(int((weights < 1.0).sum()) for weights in found.weights)


def _loads(payload: Any) -> Loads:
    return Loads(link_masses=LINKS, payload_mass=payload, payload_center=HELD)


def _load(case: LoadCase) -> Row:
    source = nominal(ARM, Path(), None, None)
    drawn = _drawn("ideal, off-axis pin", case.seed)
    assert drawn.truth is not None
    truth, tcp = drawn.truth.arm, np.array(TOOLS["off-axis"])
    rng = np.random.default_rng([case.seed, 1])
    true, _ = touched(
        truth,
        tcp,
        truth.limits,
        rng,
        points=POINTS,
        touches=LOADED_TOUCHES,
        noise=HAND_NOISE,
        way=LOOKING_DOWN,
    )
    masses = [np.resize(case.payloads, LOADED_TOUCHES)] * POINTS
    stiff = 1.0 / np.array(STIFFNESS)
    series = read_by_encoders(truth, true, sag=Sag(compliance=stiff, loads=_loads(masses)))
    found = identify(series, source.arm, loads=_loads(masses) if case.elastic else None)
    q, none = (
        flange_poses(source.arm, np.random.default_rng(0), _JUDGES, limits=truth.limits),
        np.zeros(3),
    )
    moves, before = {}, {}
    for payload in JUDGED:
        bent = true_joints(truth, q, sag=Sag(compliance=stiff, loads=_loads(payload)))
        models = {
            "nominal": source.arm.tips(q, none),
            "identified": found.arm.tips(found.deflected(q, payload), none),
        }
        clouds = compare(truth.tips(bent, none), models)
        moves[f"{payload:g}"], before[f"{payload:g}"] = (
            clouds["identified"].rms,
            clouds["nominal"].rms,
        )
    sigma = dict(zip(found.names, found.sigma, strict=True))
    hidden = {name for group in found.rank_free.hidden for name in group.names}
    names = [f"c{k}" for k in range(1, truth.n + 1)] if case.elastic else []
    return {
        "payloads": list(case.payloads),
        "elastic": case.elastic,
        "cost_m2": found.cost,
        "identified_m": moves,
        "nominal_m": before,
        "relative_sigma": [sigma[name] / c for name, c in zip(names, stiff, strict=False)],
        "hidden": [name for name in names if name in hidden],
    }


def _wild(case: WildCase) -> Row:
    source, drawn = nominal(ARM, Path(), None, None), _drawn("ideal, off-axis pin", case.seed)
    assert drawn.truth is not None
    rng = np.random.default_rng([case.seed, case.count])
    series = [np.array(q) for q in drawn.touches.series]
    wild = {
        divmod(int(k), TOUCHES) for k in rng.choice(POINTS * TOUCHES, case.count, replace=False)
    }
    for i, j in sorted(wild):
        series[i][j] += case.size * rng.standard_normal(source.arm.n)
    q, none = flange_poses(source.arm, np.random.default_rng(0), _JUDGES), np.zeros(3)
    found = identify(series, source.arm)
    models = {"clean": identify(drawn.touches.series, source.arm).arm, "found": found.arm}
    clouds = compare(
        drawn.truth.arm.tips(q, none), {name: arm.tips(q, none) for name, arm in models.items()}
    )
    flagged = {
        (i, j)
        for i, weights in enumerate(found.weights)
        for j in np.flatnonzero(weights < 1.0).tolist()
    }
    return {
        "count": case.count,
        "size_rad": case.size,
        "clean_m": clouds["clean"].rms,
        "found_m": clouds["found"].rms,
        "right": len(flagged & wild),
        "wrong": len(flagged - wild),
        "left_out": len(found.outliers),
    }


def _sockets(case: RealCase, positions: Iterable[str], arm: SerialArm) -> list[Array]:
    series: list[Array] = []
    for position in positions:
        files = [
            each
            for each in sorted((Path(case.folder) / position).glob("*.csv"))
            if "pose" not in each.stem
        ]
        series += read_touches(files, joint_types=arm.joint_types, limits=arm.limits).series
    return series


def _real(case: RealCase) -> Row:
    arm = published_arms.load(case.arm)
    positions = [each.name for each in sorted(Path(case.folder).iterdir()) if each.is_dir()]
    others = [name for name in positions if name != case.position]
    train = [case.position] if case.alone else others
    series: list[Array] = []
    distances = []
    for position in train:
        sockets = _sockets(case, [position], arm)
        distances += [
            (len(series) + k, len(series) + k + 1, case.length) for k in range(len(sockets) - 1)
        ]
        series += sockets
    found = identify(series, arm, distances=distances)
    rms, errors, halves = {}, [], []
    for position in (
        [name for name in others if name not in case.aside] if case.alone else [case.position]
    ):
        scatter = []
        for q in _sockets(case, [position], arm):
            p = found.tips(q)
            off = p - p.mean(axis=0)
            scatter.append(np.sqrt((off**2).sum(axis=1).mean()))
            errors.append(np.abs(off).ravel())
            halves.append(found.half_widths(q).ravel())
        rms[position] = float(np.mean(scatter))
    return {
        "robot": Path(case.folder).name,
        "position": case.position,
        "alone": case.alone,
        "touches": sum(len(q) for q in series),
        "reduced": _reduced(found),
        "left_out": len(found.outliers),
        "held_out_m": rms,
        "errors_m": np.round(np.concatenate(errors), 8).tolist(),
        "half_widths_m": np.round(np.concatenate(halves), 8).tolist(),
    }


def summarise(rows: list[Row]) -> Summary:
    """Tables and figures of all rows."""
    kinds = {
        kind: [row for row in rows if row["kind"] == kind]
        for kind in ("effect", "load", "wild", "real")
    }
    makers: dict[str, Callable[[list[Row]], tuple[dict[str, Any], list[Table]]]] = {
        "effect": _effects_said,
        "load": _loads_said,
        "wild": _wild_said,
        "real": _real_said,
    }
    metrics: dict[str, Any] = {}
    tables: list[Table] = []
    for kind, make in makers.items():
        if kinds[kind]:
            metrics[kind], made = make(kinds[kind])
            tables += made
    return Summary(
        metrics=metrics, tables=tables, pictures=_pictures(kinds["effect"], kinds["real"])
    )


def _grouped(rows: Sequence[Row], *names: str) -> dict[tuple[Any, ...], list[Row]]:
    out: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        key = tuple(
            tuple(row[name]) if isinstance(row[name], list) else row[name] for name in names
        )
        out.setdefault(key, []).append(row)
    return out


def _median(rows: Sequence[Row], name: str) -> float:
    return float(np.median([row[name] for row in rows]))


def _effects_said(rows: list[Row]) -> tuple[dict[str, Any], list[Table]]:
    metrics, cells = {}, []
    for (effect,), mine in _grouped(rows, "effect").items():
        ratios = np.array([row["ratio"] for row in mine])
        low, high = np.quantile(ratios, [0.1, 0.9])
        covered = sum(row["covered"] for row in mine) / sum(row["combinations"] for row in mine)
        metrics[effect] = {
            "nominal_m": _median(mine, "nominal_m"),
            "identified_m": _median(mine, "identified_m"),
            "ratio": float(np.median(ratios)),
            "ratio_10": low,
            "ratio_90": high,
            "cost_m2": _median(mine, "cost_m2"),
            "rank": sorted({row["rank"] for row in mine}),
            "covered": covered,
            "reduced": float(np.mean([row["reduced"] for row in mine])),
        }
        m = metrics[effect]
        cells.append(
            (
                effect,
                f"{1e3 * m['nominal_m']:.3f}",
                f"{1e3 * m['identified_m']:.3f}",
                f"{m['ratio']:.2f}",
                f"{low:.2f}",
                f"{high:.2f}",
                f"{1e6 * m['cost_m2']:.1f}",
                ", ".join(map(str, m["rank"])),
                f"{100 * covered:.1f} %",
            )
        )
    table = Table(
        title=f"Effects of real arms on a UR10e, median of {len(rows) // len(cells)} seeds",
        columns=(
            "in the true arm",
            "nominal [mm]",
            "identified [mm]",
            "ratio: median",
            "10 %",
            "90 %",
            "J [mm²]",
            "rank of 27",
            "in 95 % interval",
        ),
        rows=cells,
        caption="[Yukhimets 2023], the real arm: 0.672 and 0.226 mm, ratio "
        f"{PUBLISHED_RATIO:.2f}, J 28.7 mm². "
        "A wrong pose of the base changes nothing: the tracker's frame is aligned.",
    )
    return metrics, [table]


def _loads_said(rows: list[Row]) -> tuple[dict[str, Any], list[Table]]:
    metrics, moves, shares = {}, [], []
    for (payloads, elastic), mine in _grouped(rows, "payloads", "elastic").items():
        name = " ".join(f"{each:g}" for each in payloads)
        said = {
            "cost_m2": _median(mine, "cost_m2"),
            "identified_m": {
                k: float(np.median([row["identified_m"][k] for row in mine]))
                for k in mine[0]["nominal_m"]
            },
        }
        if elastic:
            said["relative_sigma"] = np.median(
                [row["relative_sigma"] for row in mine], axis=0
            ).tolist()
            said["hidden"] = sorted({each for row in mine for each in row["hidden"]})
            cells = [
                f"{100 * share:.3g} %" + (" *" if f"c{k}" in said["hidden"] else "")
                for k, share in enumerate(said["relative_sigma"], start=1)
            ]
            shares.append((name, *cells))
        metrics[f"{name} kg, {'elastic' if elastic else 'rigid'}"] = said
        in_mm = [f"{1e3 * each:.3f}" for each in said["identified_m"].values()]
        moves.append(
            (name, "elastic" if elastic else "rigid", f"{1e6 * said['cost_m2']:.0f}", *in_mm)
        )
    nominal_moves = [
        f"{1e3 * np.median([row['nominal_m'][k] for row in rows]):.3f}"
        for k in rows[0]["nominal_m"]
    ]
    judged = [f"moves at {k} kg [mm]" for k in rows[0]["nominal_m"]]
    return metrics, [
        Table(
            title="An elastic arm touched under payloads: error of moves of the flange",
            columns=("payloads [kg]", "model", "J [mm²]", *judged),
            rows=[("none", "nominal", "", *nominal_moves), *moves],
            labels=2,
        ),
        Table(
            title="Standard deviation of the compliances, share of the true value",
            columns=("payloads [kg]", *(f"c{k}" for k in range(1, len(LINKS) + 1))),
            rows=shares,
            caption="* a direction that the loads do not show; the prior holds it",
        ),
    ]


def _wild_said(rows: list[Row]) -> tuple[dict[str, Any], list[Table]]:
    metrics, cells = [], []
    for (size, count), mine in _grouped(rows, "size_rad", "count").items():
        ratios = [row["found_m"] / row["clean_m"] for row in mine]
        said = {
            "size_rad": size,
            "count": count,
            "ratio_median": float(np.median(ratios)),
            "ratio_most": max(ratios),
            **{
                name: float(np.mean([row[name] for row in mine]))
                for name in ("right", "wrong", "left_out")
            },
        }
        metrics.append(said)
        cells.append(
            (
                f"{1e3 * size:g}",
                str(count),
                f"{said['ratio_median']:.2f}",
                f"{said['ratio_most']:.2f}",
                f"{said['right']:.1f}",
                f"{said['wrong']:.1f}",
                f"{said['left_out']:.1f}",
            )
        )
    table = Table(
        title=f"Wild touches among {POINTS * TOUCHES}: error of moves of the flange over that of "
        "the clean fit",
        columns=(
            "by [mrad]",
            "wild",
            "median",
            "most",
            "found",
            "ordinary ones reduced",
            "left out",
        ),
        rows=cells,
    )
    return {"rows": metrics}, [table]


def _real_said(rows: list[Row]) -> tuple[dict[str, Any], list[Table]]:
    metrics, tables = {}, []
    for (robot, alone), mine in _grouped(rows, "robot", "alone").items():
        errors = np.concatenate([row["errors_m"] for row in mine])
        halves = np.concatenate([row["half_widths_m"] for row in mine])
        per_row = {
            row["position"]: float(np.mean(list(row["held_out_m"].values()))) for row in mine
        }
        said = {
            "held_out_m": per_row,
            "median_m": float(np.median(list(per_row.values()))),
            "covered": float(np.mean(errors < halves)),
            "width_over_spread": float(np.median(halves) / np.quantile(errors, 0.95)),
            "reduced": {row["position"]: row["reduced"] for row in mine},
            "left_out": sum(row["left_out"] for row in mine),
        }
        how = "trained on one position" if alone else "trained on all others"
        metrics[f"{robot}, {how}"] = said
        tables.append(
            Table(
                title=f"{robot}, {how}: touches held out about their sockets",
                columns=("position", "touches", "reduced", "left out", "held out [mm]"),
                rows=[
                    (
                        row["position"],
                        str(row["touches"]),
                        str(row["reduced"]),
                        str(row["left_out"]),
                        f"{1e3 * per_row[row['position']]:.3f}",
                    )
                    for row in mine
                ]
                + [("median", "", "", "", f"{1e3 * said['median_m']:.3f}")],
                caption=f"{100 * said['covered']:.1f} % of the errors within their 95 % "
                "intervals, whose median is "
                f"{said['width_over_spread']:.2f} of the errors' 95 % quantile",
            )
        )
    return metrics, tables


def _pictures(effects: list[Row], real: list[Row]) -> Iterator[tuple[str, str, Figure]]:
    if effects:
        groups = _grouped(effects, "effect")
        figure = Figure(figsize=(9.0, 0.42 * len(groups) + 1.2), layout="constrained")
        axes = figure.subplots()
        for place, mine in enumerate(groups.values(), start=1):
            least, low, median, high, most = np.quantile(
                [row["ratio"] for row in mine], [0.0, 0.25, 0.5, 0.75, 1.0]
            )
            axes.plot([least, most], [place, place], color="#0072B2", linewidth=1.0)
            axes.plot(
                [low, high], [place, place], color="#0072B2", linewidth=7.0, solid_capstyle="butt"
            )
            axes.plot(median, place, "|", color="#222222", markersize=12, markeredgewidth=2.0)
        axes.set_yticks(range(1, len(groups) + 1), [name for (name,) in groups])
        axes.axvline(PUBLISHED_RATIO, color="#D55E00", linewidth=1.0)
        axes.axvline(1.0, color="#999999", linewidth=0.8, linestyle=":")
        axes.invert_yaxis()
        axes.set_xlabel("error of the nominal arm over that of the identified one")
        yield (
            "Ratio of the errors",
            "Bars: quartiles with the median; lines: all seeds. The vertical line is the ratio of "
            "the real arm "
            "[Yukhimets 2023].",
            figure,
        )
    for (robot,), mine in _grouped(real, "robot").items():
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        axes = figure.subplots()
        names = list(dict.fromkeys(row["position"] for row in mine))
        for k, alone in enumerate((True, False)):
            values = {
                row["position"]: 1e3 * np.mean(list(row["held_out_m"].values()))
                for row in mine
                if row["alone"] == alone
            }
            places = np.arange(len(names)) + 0.4 * k - 0.2
            label = "trained on it, the others tested" if alone else "tested, trained on the others"
            axes.bar(
                places,
                [values[name] for name in names],
                0.38,
                label=label,
                color=("#999999", "#0072B2")[k],
            )
        axes.set_xticks(range(len(names)), names, rotation=20)
        axes.set_ylabel("held out, RMS [mm]")
        axes.legend(frameon=False)
        yield f"Touches held out, {robot}", "RMS distance from the mean of their socket.", figure
