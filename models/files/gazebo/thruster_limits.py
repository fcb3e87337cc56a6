"""A thruster from its curve over the command of a simulator, between limits that may be missing."""

from collections.abc import Callable, Mapping

import numpy as np

from uuv.models.files.gazebo.content import FileContent
from uuv.models.files.parts_file import MappedThruster
from uuv.models.water.thrusters import Thruster
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

# [N^(1/3)] thrust over the vehicle's weight to 2/3: BlueROV2 50 N at 98 N, RexROV 1600 N at 18 kN
PRIOR = 2.35
_POINTS = 21  # of a curve, each way
_FARTHEST = 1e6  # command up to which a curve is followed

Limits = Mapping[str, tuple[float | None, float | None]]


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
        name: of it.
        link: on which it pushes.
        axis: (3,) of positive thrust, in the link.
        curve: thrust [N] by command; None: proportional to the command's square.
        limits: least and largest "thrust" [N] and "command", None where they are not stated.
        time_constant: [s] of the propeller.
        weight: [N] of the vehicle in air, for a limit where none is stated.
        content: gets entries about it.
    """
    part = f"thruster {name}"
    astern, ahead = _ends(curve, limits)

    if not (np.isfinite(ahead) and ahead > 0.0 and np.isfinite(astern) and astern > 0.0):
        prior = PRIOR * weight ** (2.0 / 3.0)
        ahead = ahead if np.isfinite(ahead) and ahead > 0.0 else prior
        astern = astern if np.isfinite(astern) and astern > 0.0 else prior
        why = "no limit in the file: 2.35 N of weight^(2/3); `thrusters:` in the mapping states it"
        content.tell(part, "thrust", f"{ahead:.4g} and -{astern:.4g} N", "guessed", why)
    else:
        content.tell(part, "thrust", f"{ahead:.4g} and -{astern:.4g} N", "read", "its limits")

    if time_constant > 0.0:
        content.tell(part, "time constant", f"{time_constant:g} s", "read", "its dynamics")
    else:
        content.tell(part, "time constant", "0 s", "guessed", "no dynamics in the file")

    thruster = _of_curve(curve, ahead, astern, time_constant)
    if thruster is None:
        content.tell(part, "curve", "", "guessed", "quadratic: that of the file does not rise")
        thruster = Thruster(forward=ahead, reverse=astern, time_constant=time_constant)

    return MappedThruster(
        name=name, body=link, pos=np.zeros(3), direction=np.array(axis), kind=thruster
    )


def _ends(curve: Callable[[Array], Array] | None, limits: Limits) -> tuple[float, float]:
    """Thrust [N] astern and ahead at the limits, both positive; infinite: none is stated."""
    least, most = limits["thrust"]
    low, high = limits["command"]
    astern = np.inf if least is None else -least
    ahead = np.inf if most is None else most

    if curve is not None:
        reach = curve(np.array([low or -_FARTHEST, high or _FARTHEST]))
        bounded = np.abs(curve(np.array([-2.0 * _FARTHEST, 2.0 * _FARTHEST]))) <= np.abs(reach)
        if low is not None or bounded[0]:
            astern = min(astern, -float(reach[0]))
        if high is not None or bounded[1]:
            ahead = min(ahead, float(reach[1]))

    return astern, ahead


def _of_curve(
    curve: Callable[[Array], Array] | None, ahead: float, astern: float, time_constant: float
) -> Thruster | None:
    """Thruster of a curve up to its ends; None: it does not rise."""
    if curve is None:
        return Thruster(forward=ahead, reverse=astern, time_constant=time_constant)
    full = max(_command(curve, ahead), _command(lambda x: -curve(-x), astern))
    if not 0.0 < full < _FARTHEST:
        return None

    # A quadratic one needs no table.
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
    """Smallest command at which a rising curve reaches a thrust [N]; infinite: none."""
    low = 0.0
    high = _FARTHEST
    if float(curve(np.array([high]))[0]) < thrust * (1.0 - 1e-12):
        return np.inf

    for _ in range(200):
        middle = 0.5 * (low + high)
        reached = float(curve(np.array([middle]))[0]) >= thrust * (1.0 - 1e-12)
        low, high = (low, middle) if reached else (middle, high)

    return high
