"""Metric of a run with its acceptance bound."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Requirement:
    """Metric with its acceptance bound."""

    name: str
    value: float | None
    bound: float | None  # None: reported only
    unit: str
    scale: float = 1.0  # from SI to `unit`

    @property
    def ok(self) -> bool:
        """True if there is no bound, or the value is known and within it."""
        return self.bound is None or (
            self.value is not None and self.value <= self.bound * (1.0 + 1e-9)
        )

    @property
    def failure(self) -> str:
        """Message of a missed bound; empty if there is none."""
        if self.ok or self.bound is None:
            return ""
        if self.value is None:
            return f"{self.name}: no value"
        figure, bound = self.value * self.scale, self.bound * self.scale
        return f"{self.name}: {figure:.3g} {self.unit}, allowed {bound:.3g} {self.unit}"
