"""One core for what measures computing times, whatever threads the libraries would use."""

import os
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_core() -> Iterator[None]:
    """Keeps this process on one of its cores meanwhile; does nothing where the system cannot."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return

    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
