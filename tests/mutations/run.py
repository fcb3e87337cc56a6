"""Do the tests bite? Changes a copy of the source, one change at a time, and runs its tests.

    # the list in listed.toml, each with the tests that it names
    ./uvw run tests/mutations/run.py

    # mutants drawn over all rooms, with the tests that reach them
    ./uvw run tests/mutations/run.py --drawn 200 --seed 1

Prints a line for each and exits 0 only if all were seen. `--out FILE` keeps the results as they
come and takes up again where it stopped. Only tests of figures and properties count: traces and
digests are off (UUV_NO_DIGEST).
"""

import argparse
import hashlib
import json
import multiprocessing
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import tomllib
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any

import drawn
import reach

ROOT = Path(__file__).resolve().parents[2]
LISTED = Path(__file__).with_name("listed.toml")
LEFT_OUT = (".venv", ".git", ".uv", "runs", ".pytest_cache", ".ruff_cache")
PATIENCE = 8.0  # times the budget, in seconds of the clock: hung
MEMORY = 6 * 2**30  # [bytes] that a mutant may ask for
# by nearly all tests: not anew for every mutant
LOADED_ONCE = (
    "matplotlib.pyplot",
    "mujoco",
    "numba",
    "pytest",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.spatial",
    "scipy.stats",
)
MOST_FILES = 12  # of tests for a drawn mutant, the nearest first


def listed() -> list[dict[str, Any]]:
    """Entries of the list with the changed text of each file.

    Raises ValueError where one does not fit its file.
    """
    entries = tomllib.loads(LISTED.read_text())["mutant"]
    for entry in entries:
        source = (ROOT / entry["file"]).read_text()
        if source.count(entry["old"]) != 1:
            raise ValueError(
                f"{entry['file']}: {source.count(entry['old'])} times in it, not "
                f"once: {entry['old']!r}"
            )
        missing = [
            test for test in entry["tests"] if not (ROOT / test.partition("::")[0]).is_file()
        ]
        if missing or not entry["tests"] or not entry["why"] or entry["old"] == entry["new"]:
            raise ValueError(
                f"{entry['file']}, {entry['old']!r}: needs another text, existing tests "
                f"{missing}, a reason"
            )
        entry["text"] = source.replace(entry["old"], entry["new"])
        entry["line"] = source[: source.index(entry["old"])].count("\n") + 1
    return entries


def chosen(count: int, seed: int) -> list[dict[str, Any]]:
    """Drawn mutants with the tests that reach them."""
    graph = reach.Reach(ROOT)
    entries = []
    for mutant in drawn.draw(ROOT, count, seed):
        tests, files = [], []
        for test in graph.tests(mutant.file, mutant.line):
            file = test.partition("::")[0]
            if file not in files and len(files) == MOST_FILES:
                continue
            files += [] if file in files else [file]
            tests.append(test)
        entries.append(
            {name: getattr(mutant, name) for name in mutant.__slots__} | {"tests": tests}
        )
    return entries


class Watch:
    """A pytest plugin: stops at the first failure or when the time is spent, and writes down what
    happened.

    What numba takes to compile the changed file and its callers is no time of tests.
    """

    def __init__(self, report: Path, budget: float, order: list[str]) -> None:
        from numba.core import event

        self.report = report
        self.order = order
        self.end = time.process_time() + budget
        self.compiling = event.TimingListener()
        event.register("numba:compile", self.compiling)
        self.found: dict[str, Any] = {"tests_run": 0, "by": "", "spent": False}
        self._write()

    def _write(self) -> None:
        self.report.write_text(json.dumps(self.found))

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        def rank(item: Any) -> int:
            return next(
                (i for i, test in enumerate(self.order) if item.nodeid.startswith(test)),
                len(self.order),
            )

        items.sort(key=rank)
        self.found["collected"] = len(items)

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self.found["by"] = f"{report.nodeid} (collection)"
            self._write()

    def pytest_runtest_logreport(self, report: Any) -> None:
        self.found["tests_run"] += report.when == "call"
        if report.failed and not self.found["by"]:
            self.found["by"] = report.nodeid
        self._write()

    def pytest_runtest_teardown(self, item: Any) -> None:
        compiled = self.compiling.duration if self.compiling.done else 0.0
        if time.process_time() > self.end + compiled:
            self.found["spent"] = True
            self._write()
            item.session.shouldstop = "time is spent"


def run_tests(folder: Path, tests: list[str], budget: float, *options: str) -> dict[str, Any]:
    """Run `tests` on the tree in `folder`, in a process of its own that has the libraries loaded
    already.
    """
    report = folder.with_suffix(".json")
    report.unlink(missing_ok=True)
    pid = os.fork()
    if pid == 0:
        os.setsid()
        sink = os.open(folder.with_suffix(".log"), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
        os.chdir(folder)
        os.environ.update(PYTHONPATH=str(folder), PYTHONDONTWRITEBYTECODE="1", UUV_NO_DIGEST="1")
        sys.dont_write_bytecode = True
        sys.path[:] = [str(folder), *(p for p in sys.path if not p.startswith(str(ROOT / "tests")))]
        import pytest

        arguments = ["-x", "-q", "-p", "no:cacheprovider", "-n0", *options, *tests]
        os._exit(int(pytest.main(arguments, plugins=[Watch(report, budget, tests)])))
    start = time.monotonic()
    status = None
    while time.monotonic() < start + PATIENCE * budget:
        done, code = os.waitpid(pid, os.WNOHANG)
        if done:
            status = os.waitstatus_to_exitcode(code)
            break
        time.sleep(0.05)
    else:
        os.killpg(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    report_read = json.loads(report.read_text()) if report.exists() else {"by": "", "tests_run": 0}
    if status is None:
        fate = "timeout"
    elif report_read.get("spent") and not report_read["by"]:
        fate = "unseen"  # within the budget; more tests are left
    elif status == 0:
        fate = "survived"
    elif status < 0 or status in (1, 2) or report_read["by"]:
        # failed, or crashed, or did not even collect
        fate = "killed"
        report_read["by"] = report_read["by"] or f"exit {status}"
    else:
        fate = f"pytest's exit code {status}"
    return report_read | {"fate": fate, "seconds": round(time.monotonic() - start, 1)}


def _left_out(folder: str, names: list[str]) -> list[str]:
    return [name for name in names if name in LEFT_OUT and Path(folder) == ROOT]


class Copy:
    """A copy of the working tree in which one file at a time is changed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(ROOT, folder, symlinks=True, ignore=_left_out, dirs_exist_ok=True)

    def judge(self, entry: dict[str, Any], budget: float, *options: str) -> dict[str, Any]:
        """What the tests make of one change; the copy is then as before."""
        if not entry["tests"]:
            return {"fate": "survived", "by": "", "seconds": 0.0, "tests_run": 0}
        path = self.folder / entry["file"]
        path.write_text(entry["text"])
        try:
            return run_tests(self.folder, entry["tests"], budget, *options)
        finally:
            shutil.copy2(ROOT / entry["file"], path)


def work(
    entries: list[dict[str, Any]],
    tasks: Any,
    results: Any,
    folder: Path,
    budget: float,
    *options: str,
) -> None:
    """One worker: a copy of its own, mutants until there are none."""
    tree = Copy(folder)
    while (index := tasks.get()) >= 0:
        try:
            outcome = tree.judge(entries[index], budget, *options)
        except Exception as error:
            # one mutant that the runner cannot judge does not hold up the others
            outcome = {"fate": f"not judged: {error!r}", "by": "", "seconds": 0.0, "tests_run": 0}
        results.put((index, outcome))


def state_of(*options: object) -> str:
    """A digest of all sources and tests and of the options: results kept in a file hold for it
    alone.
    """
    digest = hashlib.sha256(repr(options).encode())
    for path in sorted(ROOT.rglob("*")):
        if (
            path.suffix in (".py", ".toml", ".xml", ".json")
            and path.relative_to(ROOT).parts[0] not in LEFT_OUT
        ):
            digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--drawn", type=int, metavar="N", help="draw N mutants over all rooms, not the list"
    )
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument(
        "--test-seed", type=int, metavar="K", help="run the tests on this seed, not the fixed ones"
    )
    parser.add_argument("--only", default="", help="regular expression on FILE:LINE OLD")
    parser.add_argument("-j", "--jobs", type=int, default=1)
    parser.add_argument(
        "--budget", type=float, default=60.0, help="CPU seconds of tests for a mutant"
    )
    parser.add_argument(
        "--out", type=Path, help="keep results here, one JSON a line, and go on from them"
    )
    options = parser.parse_args()
    entries = chosen(options.drawn, options.seed) if options.drawn else listed()
    entries = [e for e in entries if re.search(options.only, f"{e['file']}:{e['line']} {e['old']}")]
    seed_options = [] if options.test_seed is None else ["--seed", str(options.test_seed)]
    known = {}
    state = state_of(options.budget, options.test_seed)
    if options.out and options.out.exists():
        judged = [json.loads(line) for line in options.out.read_text().splitlines()]
        if any(outcome.pop("state") != state for outcome in judged):
            parser.error(
                f"--out {options.out}: holds results of other code, tests or options: "
                "give a new file"
            )
        known = {tuple(outcome["key"]): outcome for outcome in judged}
    rows: list[dict[str, Any]] = []

    for name in LOADED_ONCE:
        import_module(name)

    context = multiprocessing.get_context("fork")
    tasks, outcomes = context.SimpleQueue(), context.SimpleQueue()

    def say(entry: dict[str, Any], result: dict[str, Any]) -> None:
        rows.append(result)
        line = f"{entry['file']}:{entry['line']}"
        change = f"{entry['old'].strip()!r} -> {entry['new'].strip()!r}"
        print(
            f"{result['fate']:9s} {result['seconds']:6.1f} s  {line:42s} {change[:150]}  "
            f"{result['by']}",
            flush=True,
        )

    waiting = []
    for index, entry in enumerate(entries):
        key = (entry["file"], entry["old"], entry["new"], entry["line"])
        if key in known:
            say(entry, known[key])
        else:
            waiting.append(index)
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        workers = [
            context.Process(
                target=work,
                args=(
                    entries,
                    tasks,
                    outcomes,
                    Path(folder) / f"tree{i}",
                    options.budget,
                    *seed_options,
                ),
            )
            for i in range(min(options.jobs, len(waiting)))
        ]
        for worker in workers:
            worker.start()
        for index in [*waiting, *[-1] * len(workers)]:
            tasks.put(index)
        for _ in waiting:
            index, judgement = outcomes.get()
            entry = entries[index]
            say(entry, judgement)
            if options.out:
                key = (entry["file"], entry["old"], entry["new"], entry["line"])
                with options.out.open("a") as file:
                    file.write(json.dumps({"key": key, "state": state, **judgement}) + "\n")
        for worker in workers:
            worker.join()
        by = sorted({r["by"] for r in rows if "::" in r["by"]})
        if by and waiting:
            clean = run_tests(
                Path(folder) / "tree0",
                [re.sub(r"\[.*", "", test) for test in by],
                1e4,
                *seed_options,
            )
            if clean["fate"] != "survived":
                sys.exit(
                    "error: fails without any change, so what it saw is worth nothing: "
                    f"{clean['by']}"
                )
            print(
                f"the {len(by)} tests that saw something pass without a change: "
                f"{clean['seconds']} s"
            )
    fates = Counter(row["fate"] for row in rows)
    killed = fates["killed"] + fates["timeout"]
    print(
        f"{killed} of {len(rows)} seen ({100.0 * killed / max(len(rows), 1):.1f} %): {dict(fates)}"
    )
    sys.exit(0 if killed == len(rows) else 1)


if __name__ == "__main__":
    main()
