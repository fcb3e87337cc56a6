"""Progress of a check: a bar on a terminal, otherwise an occasional line."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

_SILENCE = 5.0  # [s] after which a line says how far it is


@contextlib.contextmanager
def pose_progress() -> Iterator[Callable[[str, int, int], None]]:
    """Context with a function that prints progress to standard error: of a job by name, the number
    of poses judged so far and of all poses.
    """
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
