"""Other readings of whole columns of touch files: exchanged, of the other sign, in another unit, mirrored."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np

from uuv.calib.identification import Calibration
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.touches import first_tcp
from uuv.calib.verdicts.evidence import BRIEF, Again, Doubt, Told, log_evidence
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

_SCREENED = 4  # readings of a file that are fitted, the nearest by the nominal arm
_ABOUT = np.log(3.0)  # logarithm of distances, for each point, within which a reading is worth a fit
_SIGN = "with the other sign"
_UNITS = (("in degrees", np.pi / 180.0), ("turned from degrees once too often", 180.0 / np.pi))


@dataclass(frozen=True, kw_only=True)
class ColumnReading:
    """Another reading of joint values."""

    text: str
    change: Callable[[Array], Array]  # joint values (m, n) as given -> as meant
    joints: tuple[int, ...]  # that it reads otherwise, from 0; empty: all
    mirrored: bool = False  # the arm becomes its mirror image


@dataclass(frozen=True, kw_only=True)
class Rival:
    """A reading that was fitted, with its odds against the file as given."""

    reading: ColumnReading
    doubt: Doubt


def rival_readings(found: Calibration, series: Sequence[Array], again: Again, told: Told, single: bool) -> list[Rival]:
    """Other readings of the files that explain the touches about as well or better: columns, signs, units.

    Readings that bring the touches about as close as they are, by the nominal arm, are fitted.

    Args:
        found: calibration from the files as given.
        series: their touches (m_i, n).
        again: the same identification from other touches.
        told: names of the points, known distances, joints of a moving base.
        single: also readings of one file alone.
    """
    readings = list(_readings(found.nominal, told.base_joints))
    misses = np.array([[_miss(found.nominal, each.change(q)) for q in series] for each in readings])
    given = np.array([_miss(found.nominal, q) for q in series])
    read = [(total, k, range(len(series))) for k, total in enumerate((misses - given).sum(axis=1))]
    if single and len(series) > 1:
        read += [(misses[k, i] - given[i], k, (i,)) for k in range(len(readings)) for i in range(len(series))]
    nearest = [one for one in sorted(read, key=lambda one: one[0]) if one[0] < _ABOUT * len(one[2])]
    # A mirror image may explain touches to the last digit, and other readings come closer by chance.
    mirrored = [one for one in nearest[_SCREENED:] if readings[one[1]].mirrored and len(one[2]) == len(series)]
    own, out = log_evidence(found, series), []
    for _, k, chosen in (*nearest[:_SCREENED], *mirrored):
        one = readings[k]
        meant = [one.change(q) if i in chosen else q for i, q in enumerate(series)]
        try:
            other = again(meant, distances=told.distances, method=BRIEF)
        except ConfigurationError:
            continue
        where = f" of {told.names[chosen[0]]}" if len(chosen) < len(series) else ""
        odds = log_evidence(other, meant) - own - np.log(len(read))
        out.append(
            Rival(reading=one, doubt=Doubt(reason=f"{one.text}{where} explains the touches better", log_odds=odds))
        )
    return out


def _miss(arm: SerialArm, q: Array) -> float:
    """Logarithm of the median distance of the touches `q` (m, n) from their point, by the nominal arm."""
    p = arm.tips(q, first_tcp(arm, [q]))
    return float(np.log(np.median(np.linalg.norm(p - p.mean(axis=0), axis=1)) + HAND_NOISE))


def _readings(arm: SerialArm, first: int) -> Iterator[ColumnReading]:
    """Other readings of joint values (m, n) of the joints from `first` on."""
    n, hinges = arm.n, ~arm.slides
    own = np.arange(n) >= first
    for i, j in combinations(range(first, n), 2):
        if hinges[i] == hinges[j]:
            order = np.arange(n)
            order[[i, j]] = j, i
            text = f"columns {i + 1 - first} and {j + 1 - first} exchanged"
            yield ColumnReading(text=text, change=partial(np.take, indices=order, axis=1), joints=(i, j))
    for text, factor in ((_SIGN, -1.0), *_UNITS):
        turned = own & (hinges | (factor < 0.0))
        change = partial(np.multiply, np.where(turned, factor, 1.0))
        yield ColumnReading(text=f"all joints {text}", change=change, joints=(), mirrored=factor < 0.0)
        for k in np.flatnonzero(turned):
            change = partial(np.multiply, np.where(np.arange(n) == k, factor, 1.0))
            yield ColumnReading(text=f"joint {k + 1 - first} {text}", change=change, joints=(int(k),))
