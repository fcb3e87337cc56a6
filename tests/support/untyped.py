"""Values of a type that a signature does not allow, for tests of what is then said."""

from typing import Any


def untyped(value: object) -> Any:
    """`value`, of which the type checker knows nothing."""
    return value
