"""First start: the list of kernels, the order in which they are compiled, and processes that
die.
"""

import json
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor

import pytest

from uuv import first_start
from uuv.first_start import KernelJob, decoded, encoded
from uuv.sim.interfaces.errors import UuvError

REHEARSED = """
import json
from uuv import assemble, jobs
from uuv.first_start import encoded, kernels
from uuv.runner import rehearse
from uuv.sim.interfaces.kernels.stored import StoredKernel
rehearse(assemble(jobs.clean_barrel(quick=True)))
print(json.dumps([
    (name, [encoded(kind) for kind in args])
    for name, kernel in kernels()
    for args in kernel.overloads
    if kernel._can_compile and isinstance(kernel._cache, StoredKernel)
]))
"""


@pytest.fixture(scope="module")
def jobs() -> list[KernelJob]:
    return first_start.jobs()


def test_every_type_of_the_list_is_read_and_told_the_same(jobs):
    for job in jobs:
        for argument in job.takes or []:
            assert json.loads(json.dumps(encoded(decoded(argument)))) == argument, job.kernel


def test_a_kernel_stands_after_those_that_it_calls_and_the_ticks_are_among_them(jobs):
    assert all(before < row for row, job in enumerate(jobs) for before in job.after)
    for caller, called in (
        ("uuv.ticks.tick_kernels:run_ticks", "uuv.ticks.tick_kernels:perceive"),
        (
            "uuv.controllers.safety.guard_tick:guard_tick",
            "uuv.controllers.safety.guard_tick:finite",
        ),
        (
            "uuv.controllers.whole_body.drive_tick:drive_tick",
            "uuv.controllers.whole_body.tool_tick:move_tool",
        ),
    ):
        (job,) = (job for job in jobs if job.kernel == caller)
        assert called in {jobs[row].kernel for row in job.after}


def test_the_list_holds_what_a_job_loads(jobs):
    """A kernel that is not listed would be compiled alone and silently: it is to be listed
    (`list_kernels.py`).
    """
    done = subprocess.run(
        [sys.executable, "-c", REHEARSED], capture_output=True, text=True, timeout=400, check=False
    )
    assert done.returncode == 0, done.stderr
    listed = {(job.kernel, json.dumps(job.takes)) for job in jobs}
    missing = [
        name for name, takes in json.loads(done.stdout) if (name, json.dumps(takes)) not in listed
    ]
    assert not missing


def test_rows_run_after_those_that_they_call_two_at_a_time_and_the_longest_way_first():
    todo = [
        KernelJob("a", None, (), (), 1.0),
        KernelJob("b", None, (), (), 9.0),
        KernelJob("c", None, (), (0,), 20.0),
        KernelJob("d", None, (), (1, 2), 1.0),
    ]
    begun: list[int] = []
    lock = threading.Semaphore(2)
    most = 2

    def do(row: int) -> bool:
        assert lock.acquire(blocking=False), "more than two at once"
        lock.release()
        return row != 2

    with ThreadPoolExecutor(4) as pool:

        def begin(row: int) -> Future[bool]:
            begun.append(row)  # here, for threads may overtake each other
            return pool.submit(do, row)

        ended = list(first_start._in_order(todo, range(4), begin, most))
    assert begun[:2] == [0, 1]  # 0 leads to the 20 seconds of 2
    assert sorted(ended) == [(0, True), (1, True), (2, False), (3, True)]
    assert [row for row, _ in ended].index(2) < [row for row, _ in ended].index(3)


def test_without_a_terminal_lines_say_how_far_it_is(monkeypatch, capsys):
    monkeypatch.setattr(first_start, "SILENCE", 0.02)
    with first_start._progress({3: 5.0, 8: 7.0}, workers=2) as advance:
        advance(3)
        time.sleep(0.1)
    first, *between, last = capsys.readouterr().err.splitlines()
    assert first == "first start: compiling 2 inner loops, about 6 s on 2 cores, once"
    assert between[-1].startswith("first start: 1 of 2 after ")
    assert last.startswith("first start: ended after 0 s; the loops are kept in ")
    assert all(line.isprintable() for line in (first, *between, last))


def test_the_lines_end_with_what_they_tell_of(monkeypatch, capsys):
    monkeypatch.setattr(first_start, "SILENCE", 0.02)
    with pytest.raises(KeyboardInterrupt), first_start._progress({0: 1.0}, workers=1):
        raise KeyboardInterrupt
    capsys.readouterr()
    time.sleep(0.1)
    assert capsys.readouterr().err == ""


def test_only_rows_that_are_wanted_run():
    rows = [
        KernelJob("a", None, (), (), 1.0),
        KernelJob("b", None, (), (0,), 1.0),
        KernelJob("c", None, (), (1,), 1.0),
    ]
    with ThreadPoolExecutor(1) as pool:
        ended = list(
            first_start._in_order(rows, [2, 0], lambda row: pool.submit(lambda: row == 0), 1)
        )
    assert ended == [(0, True), (2, False)]


def test_a_worker_compiles_says_what_fails_and_may_die(jobs):
    row = next(
        row
        for row, job in enumerate(jobs)
        if job.kernel == "uuv.controllers.safety.guard_tick:finite"
    )
    worker = first_start._Worker()
    try:
        assert worker.compile(row)
        assert not worker.compile(len(jobs))  # there is no such row
        assert worker.compile(row)
        worker._process.kill()
        worker._process.wait()
        assert not worker.compile(row)
    finally:
        worker.end()


def test_what_has_no_word_is_refused():
    import numba

    with pytest.raises(first_start.UuvError, match="no encoding for numba's type unicode_type"):
        encoded(numba.types.unicode_type)
    assert first_start.decoded(encoded(numba.types.none)) == numba.types.none


@pytest.mark.parametrize("kernel", ["uuv.sim.plant.thrusters:gone", "uuv.sim.plant.gone:kernel"])
def test_a_listed_kernel_that_is_gone_is_named(kernel):
    with pytest.raises(
        UuvError,
        match=rf"^list of kernels: {kernel} does not exist; "
        r".*list_kernels.py",
    ):
        KernelJob(kernel, [], (), (), 1.0).is_stored()
