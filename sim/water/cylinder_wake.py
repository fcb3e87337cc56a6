"""Wake of a circular cylinder: mean velocity deficit behind it."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, finite_number, shown, unit_vector
from uuv.sim.water.flow_field import FlowField

Vector = tuple[float, float, float]
# k1 of [Huse 1993]: ratio of half-width to the root of drag coefficient times diameter times
# distance
WIDTH = 0.25
DEPTH = 1.0  # k2: deficit on the centre line, in the same form
DRAG = 1.2  # coefficient of a smooth circular cylinder at Reynolds numbers of 1e3 to 2e5
_SOURCE = 4.0  # [diameters / drag coefficient] from the virtual source upstream to the cylinder
_HALF = math.sqrt(math.log(2.0))  # at the half-width the deficit is half of its largest value


@dataclass(frozen=True, kw_only=True)
class CylinderWake(FlowField):
    """Mean deficit behind a circular cylinder, a Gaussian that widens downstream [Huse 1993].

    At the distance x behind the axis and y to the side, with the speed U of the stream across the
    axis,

        deficit = U sqrt(C D / l) exp(-ln 2 (y / b)^2),  b = 0.25 sqrt(C D l),  l = x + 4 D / C

    with drag coefficient C and diameter D. The momentum deficit equals the drag, within 7 %.

    There are two additions to [Huse 1993]. The wake of a cylinder of finite length is blurred at
    its ends by the same Gaussian, which preserves its momentum. Over the first diameter behind the
    cylinder the deficit rises from zero, since the formula holds for the far wake.

    Vortices, the displacement of the water ahead of the cylinder, and other objects in the stream
    are not modelled.
    """

    stream: Vector  # [m/s] undisturbed velocity of the water, in W
    place: Vector  # [m] centre of the cylinder, in W
    axis: Vector  # direction of the cylinder's axis in W, of any length
    diameter: float  # [m]
    length: float  # [m]
    drag: float = DRAG  # drag coefficient, referred to the diameter

    def __post_init__(self) -> None:
        checked(self.stream, (3,), "CylinderWake stream [m/s]")
        checked(self.place, (3,), "CylinderWake place [m]")
        unit_vector(self.axis, "CylinderWake axis")
        for name, unit in (("diameter", " [m]"), ("length", " [m]"), ("drag", "")):
            finite_number(getattr(self, name), f"CylinderWake {name}{unit}", above=0.0)

    @cached_property
    def _frame(self) -> tuple[Array, float]:
        """Rows (3, 3) in W: the stream across the axis, the side, the axis; and the speed U
        [m/s].
        """
        axis = unit_vector(self.axis, "axis")
        stream = np.array(self.stream)
        across = stream - (stream @ axis) * axis
        speed = float(np.linalg.norm(across))

        # The stream is along the axis, or zero.
        if speed <= 1e-12 * float(np.linalg.norm(stream)):
            return np.zeros((3, 3)), 0.0
        along = across / speed
        return np.array([along, np.cross(axis, along), axis]), speed

    def velocity(self, p_W: Array, time: float) -> Array:
        """The deficit (3,) [m/s] at a position (3,) [m], against the stream; steady."""
        del time
        axes, speed = self._frame
        x, y, s = (axes @ (p_W - np.array(self.place))).tolist()
        if x <= 0.0 or not speed:
            return np.zeros(3)

        thickness = self.drag * self.diameter  # [m]
        away = x + _SOURCE * self.diameter / self.drag  # [m] from the virtual source
        width = WIDTH * math.sqrt(thickness * away)
        deficit = DEPTH * speed * math.sqrt(thickness / away)
        deficit *= math.exp(-((_HALF * y / width) ** 2))

        # Between the ends of the cylinder, and behind the first diameter.
        half = 0.5 * self.length
        inside = 0.5 * (math.erf(_HALF * (s + half) / width) - math.erf(_HALF * (s - half) / width))
        share = min(x / self.diameter, 1.0)
        return -deficit * inside * share * share * (3.0 - 2.0 * share) * axes[0]


def wake_behind(
    stream: Array, X_WO: Array, box: Array, diameter: float | None = None, drag: float = DRAG
) -> CylinderWake:
    """Wake of an object, approximated by a cylinder along the longest side of its box.

    Args:
        stream: Undisturbed velocity (3,) [m/s] of the water, in W.
        X_WO: Pose (4, 4) of the object.
        box: Smallest and largest coordinates (2, 3) [m] of the object in its frame.
        diameter: Diameter of the cylinder [m]; None: the mean of the box's other two sides.
        drag: Drag coefficient, referred to the diameter.

    Raises:
        ConfigurationError: The object has no extent.
    """
    sides = box[1] - box[0]
    longest = int(np.argmax(sides))
    others = np.delete(sides, longest)
    if not (np.isfinite(sides).all() and others.mean() > 0.0):
        raise ConfigurationError(
            f"wake: the sides of the object must be > 0 m, got {shown(sides)} m"
        )

    middle = X_WO[:3, :3] @ box.mean(axis=0) + X_WO[:3, 3]
    axis = X_WO[:3, longest]
    return CylinderWake(
        stream=(float(stream[0]), float(stream[1]), float(stream[2])),
        place=(float(middle[0]), float(middle[1]), float(middle[2])),
        axis=(float(axis[0]), float(axis[1]), float(axis[2])),
        diameter=float(others.mean()) if diameter is None else diameter,
        length=float(sides[longest]),
        drag=drag,
    )
