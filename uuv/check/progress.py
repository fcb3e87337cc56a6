"""How far a check is: a bar on a terminal, else a line now and then."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

_SILENCE = 5.0  # [s] after which a line says how far it is


@contextlib.contextmanager
def pose_progress() -> Iterator[Callable[[str, int, int], None]]:
    """What takes a job, the poses that are judged, and how many there are; on standard error."""
    if not sys.stderr.isatty():
        last = time.monotonic()

        def say(job: str, done: int, poses: int) -> None:
            nonlocal last
            if time.monotonic() - last > _SILENCE:
                last = time.monotonic()
                print(f"{job}: {done} of {poses} poses", file=sys.stderr, flush=True)

        yield say
        return

    columns = (TextColumn("{task.description:<20}"), BarColumn(), MofNCompleteColumn())
    with Progress(
        *columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True
    ) as bar:
        task = bar.add_task("", total=None)
        yield lambda job, done, poses: bar.update(
            task, description=job, completed=done, total=poses
        )
