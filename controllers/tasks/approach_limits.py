"""Limits of the guarded approach to a surface: a value, read without the planners' kernels."""

from dataclasses import dataclass, fields, replace
from typing import Self

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number

# [-] share of the set force, or of `touch` where that is less, below which contact counts as lost
_LOST = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ApproachLimits:
    """Guarded approach to a surface."""

    standoff: float = 0.1  # [m] distance to the surface from which the tool approaches
    # [m/s] of the depth, farther than `guard` from the expected surface; also of the retreat
    speed: float = 0.03
    touch_speed: float = 0.004  # [m/s] nearer than `guard`; gives 30 N at once on 3.6e5 N/m
    acceleration: float = 0.03  # [m/s^2] of the tool
    # [m] before the expected surface; longer than (speed^2 - touch_speed^2) / (2 acceleration)
    guard: float = 0.03
    touch: float = 6.0  # [N] estimated normal force that counts as contact
    touch_time: float = 0.04  # [s] for which it must last
    search: float = 0.06  # [m] by which the approach goes beyond the expected surface

    @property
    def least_force(self) -> float:
        """Least force [N] that can be set: half of `touch`.

        Contact then counts as lost at 1.5 N. In free water after the tare the estimate of the
        default arm reached 1.2 N, with a standard deviation of 0.2 N.
        """
        return 0.5 * self.touch

    def lost_below(self, set_force: float) -> float:
        """Estimated normal force [N] below which contact counts as lost at a set force [N]."""
        return _LOST * min(self.touch, set_force)

    def of_size(self, size: float) -> Self:
        """These for an arm whose distances beside an object are `size` [-] times the usual ones.

        A stand-off or a touch that is not the default was chosen for the arm, and stays.
        """
        usual = type(self)()
        standoff = size * self.standoff if self.standoff == usual.standoff else self.standoff
        touch = size * self.touch if self.touch == usual.touch else self.touch
        return replace(self, standoff=standoff, touch=touch)

    def __post_init__(self) -> None:
        for limit in fields(self):
            finite_number(getattr(self, limit.name), f"task.approach.{limit.name}", above=0.0)

        braking = (self.speed**2 - self.touch_speed**2) / (2.0 * self.acceleration)
        if not self.guard > braking:
            raise ConfigurationError(
                f"task.approach.guard: must exceed the {braking:.3g} m in which the tool brakes, "
                f"got {self.guard:g} m"
            )
