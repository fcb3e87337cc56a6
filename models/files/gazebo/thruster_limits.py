"""A thruster from its thrust curve over a simulator's command; its limits may be missing."""

from collections.abc import Callable, Mapping

import numpy as np

from uuv.models.files.gazebo.content import FileContent
from uuv.models.files.parts_file import MappedThruster
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

# [N^(1/3)] thrust over the vehicle's weight to the power 2/3: BlueROV2 50 N at 98 N, RexROV 1600 N
# at 18 kN
_PRIOR = 2.35
# share of the forward thrust that a thruster gets astern, if it is one-way in the file
_ONE_WAY = 0.01
_POINTS = 21  # number of points of a curve, for each direction
_FARTHEST = 1e6  # largest command up to which a curve is evaluated

Limits = Mapping[str, tuple[float | None, float | None]]


def prior_thrust(weight: float) -> float:
    """Assumed thrust [N] of each thruster of a vehicle of a weight [N], if its file states none."""
    return _PRIOR * weight ** (2.0 / 3.0)


def limited_thruster(
    name: str,
    link: str,
    axis: Array,
    curve: Callable[[Array], Array] | None,
    limits: Limits,
    time_constant: float,
    weight: float,
    content: FileContent,
) -> MappedThruster:
    """A thruster at the origin of a link.

    Args:
        name: name of the thruster.
        link: link on which it acts.
        axis: (3,) direction of positive thrust, in the link.
        curve: thrust [N] by command; None: proportional to the command's square.
        limits: smallest and largest "thrust" [N] and "command", None where they are not stated.
        time_constant: [s] of the propeller.
        weight: [N] of the vehicle in air; a missing limit is assumed from it.
        content: receives entries about the thruster.
    """
    part = f"thruster {name}"
    astern, ahead = _told_ends(_ends(curve, limits), part, weight, content)

    if time_constant > 0.0:
        content.tell(part, "time constant", f"{time_constant:g} s", "read", "its dynamics")
    else:
        content.tell(part, "time constant", "0 s", "guessed", "no dynamics in the file")

    thruster = _of_curve(curve, ahead, astern, time_constant)
    if thruster is None:
        content.tell(
            part, "curve", "", "guessed", "quadratic, since the curve of the file does not rise"
        )
        thruster = Thruster(forward=ahead, reverse=astern, time_constant=time_constant)

    return MappedThruster(
        name=name, body=link, pos=np.zeros(3), direction=np.array(axis), kind=thruster
    )


def _told_ends(
    ends: tuple[float, float], part: str, weight: float, content: FileContent
) -> tuple[float, float]:
    """Thrust [N] astern and ahead, both positive, from the result of `_ends`; entries are added to
    `content`.
    """
    astern, ahead = ends
    pushes = max(ahead, astern) > 0.0  # otherwise its limits and its curve allow no thrust
    if not pushes:
        astern = ahead = np.inf
    prior = prior_thrust(weight)
    guessed = np.isinf([astern, ahead]).any()
    astern, ahead = (prior if np.isinf(end) else end for end in (astern, ahead))

    # A thruster of this project acts in both directions.
    one_way = min(astern, ahead) <= 0.0
    if one_way:
        which = "ahead" if ahead > astern else "astern"
        least = _ONE_WAY * max(astern, ahead)
        astern = max(astern, least)
        ahead = max(ahead, least)
        why = f"the file allows thrust {which} only; {_ONE_WAY:.0%} is set for the other direction"
        content.tell(part, "thrust the other way", f"{least:.4g} N", "guessed", why)

    why = "its limits"
    if guessed:
        lacks = "no limit in the file" if pushes else "the file's limits allow no thrust"
        why = (
            f"{lacks}; assumed {_PRIOR:g} N times weight^(2/3); `thrusters:` in the mapping states "
            "it"
        )
    way = "guessed" if guessed else "read"
    content.tell(part, "thrust", f"{ahead:.4g} and -{astern:.4g} N", way, why)

    return astern, ahead


def _ends(curve: Callable[[Array], Array] | None, limits: Limits) -> tuple[float, float]:
    """Thrust [N] astern and ahead at the limits; infinite if no limit is stated.

    A value that is not positive means no thrust in that direction.
    """
    least, most = limits["thrust"]
    low, high = limits["command"]
    astern = np.inf if least is None else -least
    ahead = np.inf if most is None else most

    if curve is not None:
        ends = -_FARTHEST if low is None else low, _FARTHEST if high is None else high
        reach = curve(np.array(ends))
        bounded = np.abs(curve(np.array([-2.0 * _FARTHEST, 2.0 * _FARTHEST]))) <= np.abs(reach)
        if low is not None or bounded[0]:
            astern = min(astern, -float(reach[0]))
        if high is not None or bounded[1]:
            ahead = min(ahead, float(reach[1]))

    return astern, ahead


def _of_curve(
    curve: Callable[[Array], Array] | None, ahead: float, astern: float, time_constant: float
) -> Thruster | None:
    """Thruster of a curve up to its ends; None if the curve does not rise."""
    if curve is None:
        return Thruster(forward=ahead, reverse=astern, time_constant=time_constant)
    full = max(_command(curve, ahead), _command(lambda x: -curve(-x), astern))
    if not 0.0 < full < _FARTHEST:
        return None

    # A quadratic curve needs no table.
    share = np.linspace(-1.0, 1.0, 2 * _POINTS - 1)
    thrust = np.clip(curve(full * share), -astern, ahead)
    square = np.where(share > 0.0, ahead, astern) * share * np.abs(share)
    if np.allclose(thrust, square, atol=1e-9 * max(ahead, astern)):
        return Thruster(forward=ahead, reverse=astern, time_constant=time_constant)

    try:
        return Thruster.of_table(share, thrust, time_constant=time_constant)
    except ConfigurationError:
        return None


def _command(curve: Callable[[Array], Array], thrust: float) -> float:
    """Smallest command at which a rising curve reaches a thrust [N]; infinite if it never does."""
    low = 0.0
    high = _FARTHEST
    if float(curve(np.array([high]))[0]) < thrust * (1.0 - 1e-12):
        return np.inf

    for _ in range(200):
        middle = 0.5 * (low + high)
        reached = float(curve(np.array([middle]))[0]) >= thrust * (1.0 - 1e-12)
        low, high = (low, middle) if reached else (middle, high)

    return high
