"""Cache of results that keeps a result no longer than the object it was computed from.

`functools.lru_cache` keeps its arguments, so that scans of a finished run would stay in memory.
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
    """Decorator that keeps results of a function as long as its first argument, their owner,
    exists.

    Results must not refer to their owner, which would then never be freed. A result that is the
    owner itself is not kept.

    Args:
        most: Largest number of results for each owner; the oldest are removed first.
        owners: Number of most recent owners that are kept alive, so that a later owner of equal
            content, such as that of the next run, finds their results.
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
