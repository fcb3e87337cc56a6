"""Results that are remembered no longer than what they were worked out from.

`functools.lru_cache` holds its arguments: scans of a run that has ended would stay in memory.
"""

from collections import deque
from collections.abc import Callable
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

Owner = TypeVar("Owner")
Rest = ParamSpec("Rest")
Result = TypeVar("Result")
Function = Callable[Concatenate[Owner, Rest], Result]
Decorator = Callable[[Function[Owner, Rest, Result]], Function[Owner, Rest, Result]]

_NONE = object()


def remembered(most: int, owners: int = 0) -> Decorator[Owner, Rest, Result]:
    """Decorator: remembers results of a function as long as its first argument, their owner, lives.

    Results must not refer to their owner, for it would then live for ever. An owner that is itself
    the result is not remembered.

    Args:
        most: results for each owner, of which the oldest go first.
        owners: number of latest owners that are held, so that one of the same content that comes
            later, as in the next run, finds their results.
    """

    def decorated(function: Function[Owner, Rest, Result]) -> Function[Owner, Rest, Result]:
        memory: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()
        latest: deque[Owner] = deque(maxlen=owners)

        @wraps(function)
        def remembering(owner: Owner, *rest: Rest.args, **named: Rest.kwargs) -> Result:
            of_owner = memory.get(owner)
            if of_owner is None:
                of_owner = memory.setdefault(owner, {})
                latest.append(owner)

            key = (rest, *named.items())
            outcome = of_owner.get(key, _NONE)
            if outcome is _NONE:
                outcome = function(owner, *rest, **named)
                if outcome is not owner:
                    of_owner[key] = outcome
                while len(of_owner) > most:
                    of_owner.pop(next(iter(of_owner)), None)
            return outcome

        return remembering

    return decorated
