"""First import of every command: refuses unsuitable systems, and prints errors in one line."""

import sys
from types import TracebackType

from uuv.sim.runs.command_line import parse, run_scenario
from uuv.sim.runs.process import refuse_foreign_system
from uuv.sim.runs.run_folder import new_folder


def _in_one_line(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """Print an error of a command's imports in one line, such as a missing library."""
    from uuv.sim.interfaces.errors import UuvError

    if isinstance(error, UuvError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


refuse_foreign_system()
sys.excepthook = _in_one_line

__all__ = ["new_folder", "parse", "run_scenario"]
