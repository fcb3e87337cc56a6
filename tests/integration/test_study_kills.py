"""A study killed twenty times, its workers and nodes too: no run is lost or doubled, and the rows
are whole.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from uuv.experiment import read_rows
from uuv.experiment.cluster_keeper import kept_cluster

KILLS, CASES = 20, 400
# twice what comes until the last kill: a new node takes seconds, in which the other one goes on
RAY_CASES = 3000
LEFT = 20.0  # [s] until a cluster has ended; Ray's own agents take 60 s
SIGNALS = (signal.SIGKILL, signal.SIGTERM)
STUDY = """
import sys
sys.path.insert(0, "scripts")
from pathlib import Path
from pool_tasks import slow_and_logged
from uuv.experiment import Study, StudyOptions, Summary
if __name__ == "__main__":
    out = Path(sys.argv[1])
    study = Study(
        cases=[(case, str(out.with_suffix(".log"))) for case in range(int(sys.argv[2]))],
        run_one=slow_and_logged,
        summarise=lambda rows: Summary(metrics={"runs": len(rows)}),
    )
    options = StudyOptions(workers=2, out=out, engine=sys.argv[3])
    raise SystemExit(study.carry_out("kills", options, "Kills"))
"""

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        not Path("/proc/self/environ").exists(), reason="looks for processes in /proc"
    ),
]


def processes(marker: str) -> set[int]:
    """Those whose command or environment has `marker`, zombies left out."""
    numbers = set[int]()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            command = (entry / "cmdline").read_bytes() + (entry / "environ").read_bytes()
            if marker.encode() in command and command:
                numbers.add(int(entry.name))
        except OSError:
            continue
    return numbers - {os.getpid()}


def descendants(ancestor: int) -> set[int]:
    """Processes that a process has started, and that those have started."""
    parents = dict[int, int]()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parents[int(entry.name)] = int(
                (entry / "stat").read_text().rpartition(")")[2].split()[1]
            )
        except OSError:
            continue
    family = set[int]()
    more = {ancestor}
    while more := {number for number, parent in parents.items() if parent in more}:
        family |= more
    return family


def alive(numbers: set[int]) -> set[int]:
    """Those of some processes that have not ended; zombies have."""
    alive_numbers = set[int]()
    for number in numbers:
        try:
            state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        if state not in "ZX":
            alive_numbers.add(number)
    return alive_numbers


def at_work() -> set[int]:
    """Workers of Ray that carry out a run."""
    working = set[int]()
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if (entry / "cmdline").read_bytes().startswith(b"ray::_one"):
                working.add(int(entry.name))
        except OSError:
            continue
    return working


def there(out: Path) -> list[int]:
    """Cases of the rows in a folder."""
    return [row["case"] for row in read_rows(out)]


def wait_until(over: Callable[[], bool], what: str, limit: float = 60.0) -> None:
    began = time.monotonic()
    while not over():
        assert time.monotonic() - began < limit, what
        time.sleep(0.1)


def killed_often(
    root: Path,
    folder: Path,
    engine: str,
    cases: int,
    more: Mapping[str, str],
    workers: Callable[[], set[int]],
    node: Callable[[], None] | None = None,
) -> None:
    """Kills a study twenty times and lets it end.

    Args:
        root: The checkout.
        folder: For the study.
        engine: Its engine.
        cases: Number of its cases.
        more: Environment variables.
        workers: Processes of its workers.
        node: Kills a node and gives a new one.
    """
    script, out = folder / "study.py", folder / "out"
    script.write_text(STUDY)
    path = os.pathsep.join([str(root), str(root / "tests" / "support")])
    environment = {**os.environ, "PYTHONPATH": path, **more}
    command = [sys.executable, str(script), str(out), str(cases), engine]
    rng = np.random.default_rng(0)
    last_count = 0
    for kill in range(KILLS):
        with subprocess.Popen(
            command, cwd=root, env=environment, stdout=subprocess.DEVNULL
        ) as head:
            began = time.monotonic()
            target = last_count + int(rng.integers(1, 12))
            while (
                len(there(out)) < target
                and head.poll() is None
                and time.monotonic() - began < 120.0
            ):
                time.sleep(float(rng.uniform(0.0, 0.1)))
            assert head.poll() is None, "it ended by itself"
            time.sleep(float(rng.uniform(0.0, 0.3)))
            if kill % 4 == 3 and (running := sorted(workers() - {head.pid})):  # the study goes on
                os.kill(int(rng.choice(running)), SIGNALS[kill // 4 % 2])
                time.sleep(1.0)
            if kill % 4 == 1 and node is not None:
                node()
                assert head.poll() is None, "it ended with a node"
            head.send_signal(SIGNALS[kill % 2])
            head.wait(60.0)
        wait_until(lambda: not workers(), "workers were left behind")
        finished = there(out)
        assert len(finished) == len(set(finished)) >= last_count
        assert sorted(finished) == sorted(pq.read_table(out / "rows")["case"].to_pylist())
        last_count = len(finished)
    before = last_count
    done = subprocess.run(
        command, cwd=root, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert sorted(there(out)) == list(range(cases))
    begun = len(out.with_suffix(".log").read_text().splitlines())
    # Done again: what was under way on two workers, and after the death of one or of a node.
    assert cases <= begun <= cases + 4 * KILLS
    print(
        f"{engine}: {KILLS} kills: {cases} rows, {before} at the last kill, {begun - cases} "
        "runs begun again"
    )


def test_local_processes(root, tmp_path):
    killed_often(
        root,
        tmp_path,
        "processes",
        CASES,
        {"KILL_TEST": str(tmp_path)},
        lambda: processes(str(tmp_path)),
    )


@pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")
def test_a_ray_cluster_of_two_nodes(root, tmp_path, monkeypatch):
    cluster_utils = import_module("ray.cluster_utils")
    path = os.pathsep.join([str(root), str(root / "scripts"), str(root / "tests" / "support")])
    for name, setting in {"KILL_TEST": str(tmp_path), "PYTHONPATH": path}.items():
        monkeypatch.setenv(name, setting)
    before = descendants(os.getpid())
    with kept_cluster() as folder:  # ends the agents of a node that was killed, too
        cluster = cluster_utils.Cluster(
            initialize_head=True, head_node_args={"num_cpus": 1, "temp_dir": folder}
        )
        nodes = [cluster.add_node(num_cpus=1)]

        def another_node() -> None:
            cluster.remove_node(nodes.pop(), allow_graceful=False)
            nodes.append(cluster.add_node(num_cpus=1))

        try:
            address = {"RAY_ADDRESS": str(cluster.address)}
            killed_often(root, tmp_path, "ray", RAY_CASES, address, at_work, another_node)
        finally:
            of_cluster = descendants(os.getpid()) - before
            cluster.shutdown()
    wait_until(lambda: not alive(of_cluster), "processes of the cluster were left behind", LEFT)


@pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed")
@pytest.mark.parametrize("by", SIGNALS)
def test_a_ray_cluster_ends_with_the_study_that_started_it(root, tmp_path, by):
    script, out = tmp_path / "study.py", tmp_path / "out"
    script.write_text(STUDY)
    path = os.pathsep.join([str(root), str(root / "tests" / "support")])
    environment = {**os.environ, "PYTHONPATH": path, "KILL_TEST": str(tmp_path)}
    command = [sys.executable, str(script), str(out), str(CASES), "ray"]
    with subprocess.Popen(command, cwd=root, env=environment, stdout=subprocess.DEVNULL) as head:
        wait_until(lambda: bool(there(out)), "no row came", 120.0)
        started = descendants(head.pid)
        assert started >= at_work() != set()
        head.send_signal(by)
        head.wait(60.0)
    wait_until(lambda: not alive(started), "processes were left behind", LEFT)
    wait_until(lambda: not processes(str(tmp_path)), "processes were left behind", LEFT)
    assert len(there(out)) == len(set(there(out)))
