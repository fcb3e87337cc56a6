"""Options with which a refused job may be feasible: less force, slower water, a shorter path."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from uuv.check.checked_jobs import ARM_JOBS
from uuv.check.ready_force import push_of
from uuv.scenario import Scenario

# Options that are tried for each reason of a refusal, in this order.
_WORDS: Mapping[str, tuple[str, ...]] = {
    "force": ("forces", "load"),
    "thrust": ("forces", "load"),
    "moment": ("moment",),
    "pull": ("pull",),
    "push": ("push",),
    "list": ("forces", "current"),
    "margin": ("forces", "current", "length"),
    "reach": ("length", "arc", "forces", "load"),
    "current": ("current",),
    "hover": ("current",),
    "rest": ("current",),
    "start": ("range",),
}
_SHARES = (0.8, 0.6, 0.4, 0.2)  # of set force, current and length of a path
_ARCS = (120.0, 80.0, 40.0)  # [deg] of a path around an object
_FURTHER = (0.25, 0.5, 0.75, 1.0)  # [m] by which the range of the scan is larger


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """An option of a job with another value."""

    word: str
    value: Any

    @property
    def options(self) -> Mapping[str, Any]:
        """The change by keyword."""
        return {self.word: self.value}

    @property
    def typed(self) -> str:
        """The change as an option of the command line."""
        values = self.value if isinstance(self.value, tuple) else (self.value,)
        return f"--{self.word} {' '.join(f'{value:g}' for value in values)}"


def changes_for(code: str, name: str, scenario: Scenario) -> Iterator[list[Change]]:
    """Changes to try for a refusal, option by option, each from the smallest change on.

    Args:
        code: Of the refusal.
        name: Of the job.
        scenario: The job's.
    """
    for word in _WORDS.get(code, ()):
        if not ARM_JOBS[name].takes(word):
            continue
        changes = [Change(word=word, value=value) for value in _values(word, scenario)]
        if changes:
            yield changes


def _values(word: str, scenario: Scenario) -> Iterator[Any]:
    site = scenario.site
    match word:
        case "forces":
            # One force all along, of two digits.
            yield from ((float(f"{share * push_of(scenario):.2g}"),) for share in _SHARES)

        case "load":
            yield from (float(f"{share * push_of(scenario):.2g}") for share in _SHARES)

        # Of what is set, of two digits.
        case "moment" | "pull" | "push":
            yield from (float(f"{share * getattr(scenario.task, word):.2g}") for share in _SHARES)

        # Still water too.
        case "current" if any(site.current):
            for share in (*_SHARES, 0.0):
                yield tuple(float(f"{share * speed:.2g}") for speed in site.current)
        case "range":
            near = getattr(scenario.task, "range", None)
            if near is not None:
                yield from (round(near + more, 3) for more in _FURTHER)

        # What the object has.
        case "length":
            length = getattr(site.object, "length", None)
            if length is not None:
                yield from (round(share * length, 3) for share in _SHARES)
        case "arc":
            yield from _ARCS
        case _:
            return
