"""A study killed twenty times, its workers too: no run is lost or done twice, and the rows are whole each time."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from scenarios.study import read_rows

KILLS, CASES = 20, 400
STUDY = """
import sys
sys.path.insert(0, "scripts")
from pathlib import Path
from pool_tasks import slow_and_logged
from scenarios.study import Study, StudyOptions, Summary
if __name__ == "__main__":
    out = Path(sys.argv[1])
    study = Study(
        cases=[(case, str(out.with_suffix(".log"))) for case in range(int(sys.argv[2]))],
        run_one=slow_and_logged,
        summarise=lambda rows: Summary(metrics={"runs": len(rows)}),
    )
    raise SystemExit(study.carry_out("kills", StudyOptions(workers=2, out=out), "Kills"))
"""


def processes(marker: str) -> set[int]:
    """Those whose command or environment has `marker`, zombies left out."""
    found = set[int]()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            told = (entry / "cmdline").read_bytes() + (entry / "environ").read_bytes()
            if marker.encode() in told and told:
                found.add(int(entry.name))
        except OSError:
            continue
    return found - {os.getpid()}


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="looks for processes in /proc")
def test_twenty_kills_lose_and_double_nothing(root, tmp_path):
    script, out = tmp_path / "study.py", tmp_path / "out"
    script.write_text(STUDY)
    path = os.pathsep.join([str(root), str(root / "tests" / "support")])
    environment = {**os.environ, "PYTHONPATH": path, "KILL_TEST": str(tmp_path)}
    command = [sys.executable, str(script), str(out), str(CASES)]
    rng, seen = np.random.default_rng(0), 0
    for kill in range(KILLS):
        with subprocess.Popen(command, cwd=root, env=environment, stdout=subprocess.DEVNULL) as head:
            began, wanted = time.monotonic(), seen + int(rng.integers(1, 12))
            while len(there(out)) < wanted and head.poll() is None and time.monotonic() - began < 120.0:
                time.sleep(float(rng.uniform(0.0, 0.1)))
            assert head.poll() is None, "it ended by itself"
            time.sleep(float(rng.uniform(0.0, 0.3)))
            workers = sorted(processes(str(tmp_path)) - {head.pid})
            if kill % 4 == 3 and workers:  # the study goes on
                os.kill(int(rng.choice(workers)), (signal.SIGKILL, signal.SIGTERM)[kill // 4 % 2])
                time.sleep(1.0)
            head.send_signal((signal.SIGKILL, signal.SIGTERM)[kill % 2])
            head.wait(60.0)
        began = time.monotonic()
        while processes(str(tmp_path)):
            assert time.monotonic() - began < 30.0, f"left behind: {processes(str(tmp_path))}"
            time.sleep(0.1)
        found = there(out)
        assert len(found) == len(set(found)) >= seen
        assert sorted(found) == sorted(pq.read_table(out / "rows")["case"].to_pylist())
        seen = len(found)
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(there(out)) == list(range(CASES))
    begun = len(out.with_suffix(".log").read_text().splitlines())
    assert (
        CASES <= begun <= CASES + 4 * KILLS
    )  # done again: what was under way on two workers, and after a death of one
    print(f"{KILLS} kills: {CASES} rows, {begun - CASES} runs begun again")


def there(out: Path) -> list[int]:
    """Cases of the rows in a folder."""
    return [row["case"] for row in read_rows(out)]
