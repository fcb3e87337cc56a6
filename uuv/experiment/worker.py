"""Worker process: its start, its end with the study, and the limits of a run."""

import faulthandler
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import NoReturn

from uuv.sim.interfaces.spatial import finite_number, whole_number

_WATCH_PERIOD = 0.2  # [s] between two looks whether the parent lives
# [s] after the limit, and again the limit: then the process is ended from outside Python
_GRACE = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of each run of a study."""

    time_s: float | None = field(  # wall time of a run
        default=None, metadata={"schema": {"unit": "s", "exclusiveMinimum": 0}}
    )
    memory_mb: int | None = field(  # private memory of a worker
        default=None, metadata={"schema": {"unit": "MB", "minimum": 1}}
    )
    # Times that a run whose process died is done again; once at least: its neighbours die with it.
    retries: int = field(default=1, metadata={"schema": {"minimum": 1}})

    def __post_init__(self) -> None:
        if self.time_s is not None:
            finite_number(self.time_s, "time limit", above=0.0)
        if self.memory_mb is not None:
            whole_number(self.memory_mb, "memory limit", least=1)
        whole_number(self.retries, "retries", least=1)

    @property
    def need_a_worker(self) -> bool:
        """True if they cannot be kept in the process of the study."""
        return self.time_s is not None or self.memory_mb is not None


class TimeLimitError(BaseException):
    """A run took longer than its limit; no Exception, so that no run takes it for an error of its
    own.
    """


def begin(parent: int, limits: Limits) -> None:
    """Initialiser of a worker: ends silently on Ctrl-C, and with its parent however that ends;
    limits its memory.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        # ignored under nohup: the workers keep that
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)  # only the study prints a message
    end_with(parent)
    limit_memory(limits)


def limit_memory(limits: Limits) -> None:
    """Limits the private memory of this process; what is beyond raises MemoryError."""
    if limits.memory_mb is not None:
        import resource  # not on Windows

        most = limits.memory_mb * 2**20
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def end_with(parent: int) -> None:
    """Lets this process end when its parent, of that process id, has ended; also by SIGKILL."""
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


@contextmanager
def within_time(limit: float | None) -> Iterator[None]:
    """Raises TimeLimitError in the block once it has taken `limit` [s]; a block that hangs ends the
    process later.
    """
    if limit is None or not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, _too_long)
    signal.setitimer(signal.ITIMER_REAL, limit)
    # needs no Python: compiled code may hang
    faulthandler.dump_traceback_later(2.0 * limit + _GRACE, exit=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, before)


def _too_long(_number: int, _frame: FrameType | None) -> NoReturn:
    raise TimeLimitError


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_PERIOD)
    os._exit(1)
