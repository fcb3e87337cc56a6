"""Worker process: start, end together with the study, and limits of a run."""

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

_WATCH_PERIOD = 0.2  # [s] between two checks that the parent process is alive
# [s] plus the limit once more: time after which the process is ended from outside Python
_GRACE = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Limits of each run of a study."""

    time_s: float | None = field(  # [s] wall time of a run
        default=None, metadata={"schema": {"unit": "s", "exclusiveMinimum": 0}}
    )
    memory_mb: int | None = field(  # [bytes] private memory of a worker
        default=None, metadata={"schema": {"unit": "MB", "minimum": 1}}
    )
    # Number of repetitions of a run whose process died; at least one, because runs next to it die
    # with it.
    retries: int = field(default=1, metadata={"schema": {"minimum": 1}})

    def __post_init__(self) -> None:
        if self.time_s is not None:
            finite_number(self.time_s, "time limit", above=0.0)
        if self.memory_mb is not None:
            whole_number(self.memory_mb, "memory limit", least=1)
        whole_number(self.retries, "retries", least=1)

    @property
    def need_a_worker(self) -> bool:
        """True if the limits cannot be enforced in the process of the study."""
        return self.time_s is not None or self.memory_mb is not None


class TimeLimitError(BaseException):
    """A run took longer than its limit. The class is not an Exception, so that a run does not catch
    it as its own error.
    """


def begin(parent: int, limits: Limits) -> None:
    """Initialiser of a worker. The worker ends silently on Ctrl-C, and together with its parent,
    and its memory is limited.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        # signals that are ignored under nohup stay ignored in the workers
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)  # only the study prints a message
    end_with(parent)
    limit_memory(limits)


def limit_memory(limits: Limits) -> None:
    """Limit the private memory of this process; a larger request raises MemoryError."""
    if limits.memory_mb is not None:
        import resource  # not available on Windows

        most = limits.memory_mb * 2**20
        resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def end_with(parent: int) -> None:
    """Let this process end when its parent, with that process id, has ended, also after SIGKILL."""
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


@contextmanager
def within_time(limit: float | None) -> Iterator[None]:
    """Context manager that raises TimeLimitError in the block after `limit` [s]. If the block
    hangs, the process is ended later.
    """
    if limit is None or not hasattr(signal, "setitimer"):
        yield
        return
    before = signal.signal(signal.SIGALRM, _too_long)
    signal.setitimer(signal.ITIMER_REAL, limit)
    # works without Python, since compiled code may hang
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
