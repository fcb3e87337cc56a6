"""One core for measurements of computing times, independent of the threads of libraries."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_core() -> Iterator[None]:
    """Context manager that keeps this process on one of its cores, if the system supports it."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return

    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
