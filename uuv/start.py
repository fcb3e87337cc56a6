"""First import of every command: rejects a Python without the project, or a foreign module with a room's name.

`uuv.sim.runs.command_line` cannot do that alone: a user's `sim.py` would hide it too.
"""

import sys
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType

_beside = Path(__file__).resolve().parents[1]  # where the wheel is installed the rooms are here, in a checkout above
_ours = next(home for home in (_beside, _beside.parent) if (home / "sim").is_dir()) / "sim" / "__init__.py"
_found = find_spec("sim")
if _found is None or _found.origin is None:
    print("error: this Python does not have the project; use ./uvw run scripts/NAME.py", file=sys.stderr)
    raise SystemExit(2)
if Path(_found.origin).resolve() != _ours:
    print(f"error: {_found.origin} hides the room {_ours.parent}; rename it or take it off PYTHONPATH", file=sys.stderr)
    raise SystemExit(2)

from uuv.sim.runs.process import refuse_foreign_system  # noqa: E402  after the check

refuse_foreign_system()

from uuv.sim.runs.command_line import ScenarioOptions, check, parse, run_scenario  # noqa: E402  likewise
from uuv.sim.runs.run_folder import new_folder  # noqa: E402  likewise


def _in_one_line(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """What the imports of a command refuse, such as a missing library, is one line as well."""
    from uuv.sim.interfaces.errors import UuvError

    if isinstance(error, UuvError):
        print(f"error: {error}", file=sys.stderr)
    else:
        sys.__excepthook__(kind, error, trace)


check()
sys.excepthook = _in_one_line

__all__ = ["ScenarioOptions", "new_folder", "parse", "run_scenario"]
