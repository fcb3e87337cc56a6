"""Comparison of campaigns: statistics in closed form, pairs by their draw, and every refusal in one
line.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuv.campaigns.comparison import Finished, PairedMetric, compared, mcnemar
from uuv.experiment.row_table import Row, RowTable
from uuv.sim.interfaces.errors import ConfigurationError


def folder(path: Path, lost: list[float | None], **other: Any) -> Path:
    """A finished campaign with one metric; `other` replaces entries of its metrics.json."""
    path.mkdir()
    rows: list[Row] = [
        {
            "case": case,
            "values": {"seed": case, "x": 0.1 * case},
            "drawn": {},
            "state": "done",
            "code": "",
            "accepted": True,
            "metrics": {"lost_s": lost_s},
        }
        for case, lost_s in enumerate(lost)
    ]
    RowTable(path).extend(rows)
    about = {"bounds": {"lost_s": 1.0}, "replay": "uuv campaign mine.toml --replay", **other}
    (path / "metrics.json").write_text(json.dumps(about))
    return path


def test_mcnemar_in_closed_form():
    """One against five discordant pairs: 2 (1 + 6) / 2^6."""
    a = [True] * 9 + [True] + [False] * 5
    b = [True] * 9 + [False] + [True] * 5
    assert mcnemar(a, b) == (1, 5, pytest.approx(14.0 / 64.0))
    assert mcnemar(a, a) == (0, 0, 1.0)


def test_wilcoxon_in_closed_form(rng):
    """Ten differences of one sign: 2 / 2^10."""
    a = rng.uniform(size=10)
    paired = PairedMetric.of("x", a, a - np.arange(1.0, 11.0), rng)
    assert paired.p == pytest.approx(2.0 / 1024.0)
    assert (paired.less, paired.equal, paired.more) == (10, 0, 0)
    assert paired.median == pytest.approx(-5.5)
    assert paired.low < -5.5 < paired.high < 0.0
    same = PairedMetric.of("x", a, a, rng)
    assert (same.p, same.median, same.low, same.high, same.equal) == (1.0, 0.0, 0.0, 0.0, 10)


def test_the_median_of_differences_is_not_the_difference_of_medians(rng):
    a, b = np.array([1.0, 2.0, 9.0]), np.array([2.0, 8.0, 9.5])
    paired = PairedMetric.of("x", a, b, rng)
    assert (paired.median_a, paired.median_b, paired.median) == (2.0, 8.0, 1.0)


def test_the_interval_of_the_median_holds_it_at_the_stated_rate():
    rng = np.random.default_rng(0)
    held = []
    for _ in range(200):
        paired = PairedMetric.of("x", np.zeros(40), rng.exponential(size=40), rng)
        held.append(paired.low <= np.log(2.0) <= paired.high)

    assert np.mean(held) > 0.95 - 3.1 * np.sqrt(0.95 * 0.05 / 200)  # measured 0.945


def test_runs_are_paired_and_changed_verdicts_can_be_replayed(tmp_path):
    a = Finished.read(folder(tmp_path / "a", [0.0, 0.0, 2.0, 0.5, None]))
    b = Finished.read(folder(tmp_path / "b", [0.0, 3.0, 0.5, 0.4]))
    summary = compared(a, b)
    assert summary.metrics["pairs"] == 4
    assert summary.metrics["without_partner"] == {"a": 1, "b": 0}
    assert summary.metrics["kept"] == {"a": 3, "b": 3, "only_a": 1, "only_b": 1, "p": 1.0}
    assert [changed["case"] for changed in summary.metrics["changed"]] == [1, 2]
    (lost,) = summary.metrics["metrics"]
    assert (lost.pairs, lost.less, lost.equal, lost.more) == (4, 2, 1, 1)
    assert summary.tables[1].rows[0][3].endswith("--replay 1")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            lambda row: row["values"].update(x=9.0),
            r"the draws must be equal: case 0 has x 0.0 in A, 9.0 in "
            r"B",
        ),
        (lambda row: row["metrics"].update(more=1.0), r"only one has more"),
        (lambda row: row.update(case=77), r"no common case"),
    ],
)
def test_what_cannot_be_compared_is_refused(tmp_path, change, said):
    a = Finished.read(folder(tmp_path / "a", [0.0]))
    b = Finished.read(folder(tmp_path / "b", [0.0]))
    row = b.rows[0]
    change(row)
    other = Finished(folder=b.folder, rows={row["case"]: row}, bounds=b.bounds, replay=b.replay)
    with pytest.raises(ConfigurationError, match=said):
        compared(a, other)


def test_the_command(verb, tmp_path):
    """A page, figures and a table; and one line for each mistake."""
    a, b = folder(tmp_path / "a", [0.0, 0.2, 2.0]), folder(tmp_path / "b", [0.0, 0.1, 0.5])
    out = tmp_path / "out"
    done = verb("compare-campaigns", str(a), str(b), "--out", str(out))
    assert done.returncode == 0, done.stderr
    assert "1 in B only" in done.stdout
    assert "lost_s" in done.stdout
    assert json.loads((out / "metrics.json").read_text())["kept"]["only_b"] == 1
    assert (out / "report.html").read_text().count("<img") == 1

    (tmp_path / "none").mkdir()
    bounds = folder(tmp_path / "bounds", [0.0, 0.1, 0.5], bounds={"lost_s": 2.0})
    running = folder(tmp_path / "running", [0.0])
    (running / "metrics.json").unlink()
    for other, words in (
        (tmp_path / "none", "must be the folder of a campaign"),
        (bounds, "the bounds must be equal"),
        (running, "must be the folder of a finished campaign"),
    ):
        done = verb("compare-campaigns", str(a), str(other), "--out", str(tmp_path / "x"))
        assert done.returncode == 2
        assert done.stderr.startswith("error: ")
        assert done.stderr.count("\n") == 1
        assert words in done.stderr
        assert not (tmp_path / "x").exists()
    done = verb("compare-campaigns", str(a), str(b), "--out", str(out))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
