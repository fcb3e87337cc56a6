"""First import of every command: refuses unfit systems, and makes one line of each error."""

import sys
from types import TracebackType

from uuv.sim.runs.command_line import parse, run_scenario
from uuv.sim.runs.process import refuse_foreign_system
from uuv.sim.runs.run_folder import new_folder


def _in_one_line(
    kind: type[BaseException], error: BaseException, trace: TracebackType | None
) -> None:
    """What the imports of a command refuse, such as a missing library, is one line as well."""
    from uuv.sim.interfaces.errors import UuvError

    if isinstance(error, UuvError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


refuse_foreign_system()
sys.excepthook = _in_one_line

__all__ = ["new_folder", "parse", "run_scenario"]
