"""The study harness: rows do not depend on who makes them, nothing done is lost, and nothing stale
is taken for new.
"""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

from pool_tasks import (
    DEADLY,
    deadly,
    dying,
    hungry,
    ignores,
    refusing,
    sleeping,
    squared,
    told_dead,
)
from uuv.experiment import (
    Row,
    Study,
    StudyOptions,
    Summary,
    Table,
    harness,
    local_processes,
    read_rows,
    row_table,
)
from uuv.experiment.loaded_code import digests, loaded_files
from uuv.experiment.row_log import RowLog
from uuv.experiment.worker import Limits
from uuv.sim.interfaces.errors import ConfigurationError, UuvError

TIMED = {"wall_s": 1.0, "cpu_s": 1.0}


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)


def summed(rows: list[Row]) -> Summary:
    """Sum of the values; the bound is that all have one."""
    failed = [f"run {row['run']} has no value" for row in rows if "value" not in row]
    return Summary(
        metrics={
            "runs": [row["run"] for row in rows],
            "sum": sum(row.get("value", 0.0) for row in rows),
        },
        tables=[
            Table(
                title="<T>",
                columns=("run", "value"),
                rows=[(str(row["run"]), "[b]") for row in rows],
            )
        ],
        failed=failed,
    )


def carried_out(study: Study, **options: Any) -> tuple[int, dict[str, Any]]:
    """Exit code and metrics of a study in ./out."""
    code = study.carry_out(
        "x", StudyOptions(**{"out": Path("out"), "workers": 1, **options}), "A study"
    )
    return code, json.loads(Path("out/metrics.json").read_text())


def rows_of(folder: str = "out") -> list[dict[str, Any]]:
    return read_rows(folder)


# -- studies ---------------------------------------------------------------------------------------


def test_rows_do_not_depend_on_who_makes_them():
    study = Study(cases=range(6), run_one=squared, summarise=summed)
    _, here = carried_out(study)
    by_key = {row["case_id"]: row for row in rows_of()}
    _, parallel = carried_out(study, workers=2, anew=True)
    assert here["sum"] == parallel["sum"] > 0.0
    assert here["runs"] == parallel["runs"] == list(range(6))
    for row in rows_of():
        mine = by_key[row["case_id"]]
        assert row["process"] != mine["process"] == os.getpid()
        assert {**row, "process": 0, "timing": 0} == {**mine, "process": 0, "timing": 0}
    page = Path("out/report.html").read_text()
    assert "&lt;T&gt;" in page
    assert "accepted" in page


def test_what_is_there_is_not_done_again_and_more_runs_are_added(capsys):
    carried_out(Study(cases=range(3), run_one=squared, summarise=summed))
    before = rows_of()
    capsys.readouterr()
    code, metrics = carried_out(Study(cases=(4, 2, 0), run_one=squared, summarise=summed))
    assert code == 0
    assert "2 of 3 runs are already done" in capsys.readouterr().out
    assert metrics["runs"] == [4, 2, 0]
    assert rows_of()[:3] == before
    assert [row["run"] for row in rows_of()] == [0, 1, 2, 4]


def test_a_killed_study_goes_on_where_it_was():
    def once(run: int) -> Row:
        if run == 2:
            raise KeyboardInterrupt
        return squared(run)

    with pytest.raises(KeyboardInterrupt):
        carried_out(Study(cases=range(4), run_one=once, summarise=summed))
    assert [row["run"] for row in rows_of()] == [0, 1]
    whole = carried_out(Study(cases=range(4), run_one=squared, summarise=summed))
    _ = rows_of()
    Path("out").rename("old")
    assert whole == carried_out(Study(cases=range(4), run_one=squared, summarise=summed))


def test_a_failed_case_ends_the_study_or_has_a_row_of_its_own():
    study = Study(cases=range(4), run_one=refusing, summarise=summed)
    with pytest.raises(UuvError, match="no luck with 2"):
        carried_out(study)
    reasons: list[str] = []

    def failed(case: int, reason: str) -> Row:
        reasons.append(reason)
        return {"run": case}

    for run_one, reason in ((refusing, "no luck with 2"), (deadly, harness.DIED)):
        study = Study(cases=range(4), run_one=run_one, summarise=summed, failed=failed)
        code, metrics = carried_out(study, workers=2, anew=True)
        assert reasons.pop() == reason
        assert code == harness.NOT_ACCEPTED
        assert metrics["failed"] == [f"run {DEADLY} has no value"]
        assert metrics["runs"] == [0, 1, 2, 3]


def test_a_row_is_the_same_new_as_read_again():
    """Tuples, numbers of NumPy, names that are no text, and numbers that JSON lacks: as a file
    gives them back.
    """
    read_rows: list[list[Row]] = []

    def summarise(rows: list[Row]) -> Summary:
        read_rows.append(rows)
        return Summary(metrics={"least": np.float64(-np.inf)})

    def odd(_: int) -> dict[str, Any]:
        return {
            "a": (1, np.float32(0.1)),
            "b": {1: np.arange(2.0)},
            "c": [np.nan, np.inf, np.bool_(True)],
        }

    for _ in range(2):
        code, metrics = carried_out(Study(cases=[0], run_one=odd, summarise=summarise))
        assert code == 0
        assert metrics["least"] is None
        assert "accepted" not in metrics  # there are no bounds
    assert (
        read_rows[0]
        == read_rows[1]
        == [{"a": [1, float(np.float32(0.1))], "b": {"1": [0.0, 1.0]}, "c": [None, None, True]}]
    )


@dataclass(frozen=True)
class Point:
    name: str
    at: Any


def test_cases_are_told_apart_by_all_that_they_hold():
    cases = [
        *(Point("a", at) for at in (0.0, 1e-300, np.nan, np.inf, -np.inf, None, (1.0, 2.0), "0.0")),
        Point("b", 0.0),
        (Point("a", 0.0), 1),
        (Point("a", 0.0), 2),
        Point("a", np.array([1.0, 3.0])),
    ]
    assert len({harness.key_of(case) for case in cases}) == len(cases)
    assert harness.key_of(Point("a", np.array([1.0, 2.0]))) == harness.key_of(
        Point("a", (1.0, 2.0))
    )
    assert harness.key_of(frozenset("abc")) == harness.key_of(frozenset("cba"))


def test_a_study_without_an_out_is_in_a_folder_of_its_name():
    study = Study(cases=[1], run_one=squared, summarise=summed)
    assert study.carry_out("study_x", StudyOptions(workers=1), "A study") == 0
    home = Path("runs/study_x")
    files = {
        path.name for path in home.iterdir() if path.is_file() and not path.name.startswith(".")
    }
    assert [path.name for path in (home / "rows").iterdir()] == ["000000.parquet"]
    assert files == {"study.json", "metrics.json", "report.html"}


@pytest.mark.parametrize(
    ("given", "said"), [({"workers": -1}, "--workers: must be at least 0, got -1")]
)
def test_numbers_of_processes_are_checked(given, said):
    with pytest.raises(ConfigurationError, match=said):
        StudyOptions(**given)


# -- log -------------------------------------------------------------------------------------------


def begun(folder: Path) -> RowLog:
    log = RowLog(folder)
    for run in range(2):
        log.add([(str(run), {"run": run}, TIMED)])
    return log


def test_rows_are_stale_once_a_file_that_was_loaded_has_changed(tmp_path, monkeypatch):
    """A user's module counts, the data in a package too; what is installed does not."""
    package = tmp_path / "of_user"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "table.csv").write_text("1")
    monkeypatch.syspath_prepend(str(tmp_path))
    __import__("of_user")
    files = loaded_files()
    assert {str(package / "__init__.py"), str(package / "table.csv")} <= files
    assert "uuv/experiment/harness.py" in files
    assert not any("numpy" in file for file in files)
    folder = tmp_path / "out"
    folder.mkdir()
    begun(folder).depends_on(digests(files))
    assert set(RowLog(folder).rows) == {"0", "1"}
    (package / "table.csv").write_text("2")
    with pytest.raises(
        ConfigurationError,
        match=r"has runs of other code \(changed: "
        r".*table.csv\); discard them by --anew",
    ):
        RowLog(folder)
    assert RowLog(folder, anew=True).rows == {}
    assert digests([str(package / "gone")]) == {str(package / "gone"): ""}


def test_two_studies_do_not_share_a_folder(root, tmp_path):
    other = (
        "import sys, pathlib, uuv.sim.runs.run_folder as of\nwith "
        "of.alone_in(pathlib.Path(sys.argv[1])): pass"
    )
    command = [sys.executable, "-c", other, str(tmp_path)]
    with RowLog.open(tmp_path):
        refused = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        assert f"in use by the process {os.getpid()}" in refused.stderr
    assert subprocess.run(command, cwd=root, check=False).returncode == 0


def test_a_study_leaves_the_files_of_others_alone(tmp_path):
    (tmp_path / "metrics.json").write_text("{}")
    with pytest.raises(
        ConfigurationError, match=r"files that are no experiment's \(metrics.json\)"
    ):
        RowLog(tmp_path)


def test_a_damaged_file_is_named_and_costs_no_row(tmp_path):
    begun(tmp_path)
    file = tmp_path / "rows" / "000000.parquet"
    whole = file.read_bytes()
    file.write_bytes(whole[:-20])
    with pytest.raises(ConfigurationError, match=r"000000.parquet: is not a complete Parquet file"):
        RowLog(tmp_path)
    assert file.read_bytes() == whole[:-20]


def test_rows_of_an_earlier_version_are_refused_until_they_may_go(tmp_path):
    (tmp_path / "study.json").write_text("{}")
    (tmp_path / "results.jsonl").write_text("{}\n")
    with pytest.raises(
        ConfigurationError,
        match=r"rows of an earlier version \(results.jsonl\); "
        r"discard them by --anew",
    ):
        RowLog(tmp_path)
    assert RowLog(tmp_path, anew=True).rows == {}
    assert not (tmp_path / "results.jsonl").exists()


def test_anew_leaves_nothing_of_the_old_runs(tmp_path):
    begun(tmp_path)
    for name in ("metrics.json", "report.html"):
        (tmp_path / name).write_text("")
    assert RowLog(tmp_path, anew=True).rows == {}
    assert {path.name for path in tmp_path.iterdir()} == {"rows", "study.json"}
    assert not list((tmp_path / "rows").iterdir())


def test_log_goes_on_where_it_was_cut(tmp_path):
    begun(tmp_path)
    (tmp_path / ".000000.parquet.123").write_bytes(b"PAR1")  # of a process that was killed
    log = RowLog(tmp_path)
    assert [*log.rows] == ["0", "1"]
    log.add([("2", {"run": 2}, TIMED)])
    assert [row["run"] for row in RowLog(tmp_path).rows.values()] == [0, 1, 2]
    assert {path.name for path in tmp_path.iterdir()} == {"rows", "study.json"}


class Counted(str):
    """Key of a case that counts how often it is compared."""

    __slots__ = ()
    comparisons = 0

    def __eq__(self, other: object) -> bool:
        Counted.comparisons += 1
        return super().__eq__(other)

    __hash__ = str.__hash__


def test_a_row_is_found_without_a_search_and_each_file_written_once(tmp_path, monkeypatch):
    log = RowLog(tmp_path)
    count = 2 * row_table.CHUNK + 5
    log.add([(Counted(run), {"run": run}, TIMED) for run in range(count)])

    written: list[int] = []
    write = row_table.RowTable._write
    monkeypatch.setattr(
        row_table.RowTable,
        "_write",
        lambda self, number, table: (written.append(number), write(self, number, table)),
    )
    Counted.comparisons = 0
    again = [3, 4, count - 1]
    log.add([(Counted(run), {"run": -run}, TIMED) for run in [*again, count]])

    assert written == [0, 2, 2]  # two files with old rows, then the last one with the new row
    assert Counted.comparisons < 10 * len(again)  # measured 12; a search compares with hundreds
    expected = [-run if run in again else run for run in range(count)] + [-count]
    assert [row["run"] for row in RowLog(tmp_path).rows.values()] == expected
    assert [row["run"] for row in log.rows.values()] == expected


def test_settings_are_kept_beside_the_rows(tmp_path):
    begun(tmp_path).made_with({"seed": 3})
    RowLog(tmp_path).depends_on(digests(["pyproject.toml"]))
    about = json.loads((tmp_path / "study.json").read_text())
    assert about["settings"] == {"seed": 3}
    assert about["schema"] == 1


# -- processes -------------------------------------------------------------------------------------


def test_a_run_that_kills_its_process_is_told_and_the_others_are_done():
    rows = [row for _, row in local_processes.run_all(range(5), 2, deadly, told_dead)]
    assert sorted(row["run"] for row in rows) == list(range(5))
    assert [row["run"] for row in rows if "value" not in row] == [2]


def test_no_run_is_lost_where_a_pool_breaks_between_two_of_them(monkeypatch):
    class Breaking(ThreadPoolExecutor):
        """Refuses the second run that it is given, as a pool does of which a process died
        meanwhile.
        """

        given = 0

        def shutdown(self, *what: Any, **how: Any) -> None:
            super().shutdown()

        def submit(self, *what: Any, **how: Any) -> Any:
            self.given += 1
            if self.given == 2:
                raise BrokenProcessPool
            return super().submit(*what, **how)

    monkeypatch.setattr(local_processes, "_pool", lambda workers, _: Breaking(workers))
    rows = [row for _, row in local_processes.run_all(range(4), 2, squared, told_dead)]
    assert sorted(row["run"] for row in rows) == list(range(4))
    assert all("value" in row for row in rows)


def test_a_run_beyond_its_limits_is_told_and_the_others_are_done():
    cases = (0.0, 600.0)

    def failed(case, reason):
        return {"run": case, "reason": reason}

    study = Study(cases=cases, run_one=sleeping, summarise=summed, failed=failed)
    study.carry_out("x", StudyOptions(out=Path("out"), workers=2), "A study", Limits(time_s=1.0))
    assert {row["run"]: row.get("reason") for row in rows_of()} == {
        0.0: None,
        600.0: "not finished within 1 s",
    }
    study = Study(cases=(1, 4000), run_one=hungry, summarise=summed, failed=failed)
    study.carry_out(
        "x", StudyOptions(out=Path("out"), workers=1, anew=True), "A study", Limits(memory_mb=2000)
    )
    assert {row["run"]: row.get("reason") for row in rows_of()} == {1: None, 4000: "out of memory"}


def test_a_run_is_done_again_as_often_as_it_may(tmp_path):
    for retries in (1, 2):
        tasks = [str(tmp_path / f"{retries}")]
        assert list(local_processes.run_all(tasks, 1, dying, len, Limits(retries=retries))) == [
            (tasks[0], len(tasks[0]))
        ]
        assert len(Path(tasks[0]).read_text()) == retries + 1


def test_a_run_whose_process_died_is_done_again_by_the_same_command(capsys):
    def failed(case: int, reason: str) -> Row:
        return {"run": case, "reason": reason}

    carried_out(Study(cases=range(4), run_one=deadly, summarise=summed, failed=failed), workers=2)
    assert f"1 runs: {harness.DIED}; the same command does them again" in capsys.readouterr().out
    before = {row["run"]: row for row in rows_of()}
    assert [run for run, row in before.items() if "value" not in row] == [DEADLY]
    code, metrics = carried_out(
        Study(cases=range(4), run_one=squared, summarise=summed, failed=failed)
    )
    assert "3 of 4 runs are already done" in capsys.readouterr().out
    after = {row["run"]: row for row in rows_of()}
    assert code == 0
    assert len(rows_of()) == 4
    assert list(after) == list(before)
    assert all(after[run] == row for run, row in before.items() if run != DEADLY)
    assert metrics["sum"] == pytest.approx(sum(row["value"] for row in after.values()))


def test_rows_of_other_code_are_summed_up_without_a_run(tmp_path):
    carried_out(Study(cases=range(3), run_one=squared, summarise=summed))
    about = json.loads(Path("out/study.json").read_text())
    Path("out/study.json").write_text(json.dumps(about | {"code": {"scripts/gone.py": "0"}}))
    study = Study(cases=range(5), run_one=squared, summarise=summed)
    with pytest.raises(ConfigurationError, match="other code"):
        carried_out(study)
    assert study.sum_up("x", StudyOptions(out=Path("out")), "A study") == 0
    assert json.loads(Path("out/metrics.json").read_text())["runs"] == [0, 1, 2]
    with pytest.raises(ConfigurationError, match="has no row of this experiment"):
        study.sum_up("x", StudyOptions(out=tmp_path / "none"), "A study")


def test_a_file_that_changes_while_a_study_is_at_work_ends_it(tmp_path):
    log = begun(tmp_path)
    log.depends_on({"one.py": "a", "two.py": "b"})
    log.depends_on({"two.py": "b", "three.py": "c"})
    with pytest.raises(ConfigurationError, match=r"two\.py: changed during the experiment"):
        log.depends_on({"two.py": "x"})


def test_workers_ignore_the_signals_that_the_study_ignores():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        ignored = dict(
            local_processes.run_all([signal.SIGINT, signal.SIGTERM], 1, ignores, told_dead)
        )
    finally:
        signal.signal(signal.SIGINT, before)
    assert ignored == {signal.SIGINT: True, signal.SIGTERM: False}


WATCHED = """
import sys
sys.path.insert(0, "scripts")
from uuv.experiment.local_processes import run_all
from pool_tasks import told_dead, waiting
if __name__ == "__main__":
    for _ in run_all([sys.argv[1] + "/0", sys.argv[1] + "/1"], 2, waiting, told_dead): pass
"""


def gone(process: int) -> bool:
    """Whether it has ended (what nobody has waited for has ended as well)."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")
def test_workers_end_with_a_study_that_is_killed(root, tmp_path):
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(root), str(root / "tests" / "support")]),
    }
    (tmp_path / "study.py").write_text(WATCHED)
    with subprocess.Popen(
        [sys.executable, tmp_path / "study.py", tmp_path], cwd=root, env=environment
    ) as study:
        until(lambda: len(list(tmp_path.glob("[01]"))) == 2, "its workers are at work")
        workers = [int(file.read_text()) for file in tmp_path.glob("[01]")]
        assert not any(map(gone, workers))
        study.kill()
    until(lambda: all(map(gone, workers)), "they are gone")


def until(true: Callable[[], bool], what: str, longest: float = 60.0) -> None:
    """Wait for it; a failure after `longest` [s]."""
    began = monotonic()
    while not true():
        assert monotonic() - began < longest, f"not within {longest:g} s: {what}"
        sleep(0.02)
