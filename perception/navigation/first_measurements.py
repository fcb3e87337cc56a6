"""First measurements by kind, with which navigation begins."""

from collections.abc import Sequence
from typing import TypeVar

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Measurement

M = TypeVar("M", bound=Measurement)


def first_of(kind: type[M], measurements: Sequence[Measurement]) -> M:
    """The measurement of that kind; the last if there are several.

    Raises:
        ConfigurationError: There is none.
    """
    of_kind = [measurement for measurement in measurements if isinstance(measurement, kind)]
    if not of_kind:
        raise ConfigurationError(
            f"navigation: the first measurements must include a {kind.__name__}"
        )
    return of_kind[-1]
