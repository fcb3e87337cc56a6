"""Validation of touch series, and the initial tool point [Yukhimets 2023, eq. 12-16]."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, real_array, shown

# [rad], relative to the reach for slides: least RMS motion of a joint that is identified
STILL, STILL_SHARE = np.deg2rad(1.0), 5e-3
_SAME = 1e-9  # [rad] or [m] difference, below which two touches count as one that was written twice
_TWO_TURNS = 4.0 * np.pi  # [rad] larger joint angles are assumed to be in degrees
_LONGEST_SLIDE = 50.0  # [m] larger values of a slide are assumed to be in millimetres
# ratio of spreads (radians to degrees), from which on angles are assumed to be in degrees
_FIT_BETTER = 3.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsableTouches:
    """Checked touches, and the selection of those that contain information on the arm."""

    series: list[Array]  # (m_i, n) of every point
    # rows of each series that are not repeats; none for a series of one touch
    kept: list[np.ndarray]
    live: list[int]  # indices of the series of which rows are kept
    tcp: Array  # (3,) [m] initial tool point in the flange
    warnings: tuple[str, ...]

    @property
    def used(self) -> list[Array]:
        """The touches that are kept, for each series in use."""
        return [self.series[i][self.kept[i]] for i in self.live]


def usable(
    series: Sequence[ArrayLike], arm: SerialArm, tcp: ArrayLike | None = None
) -> UsableTouches:
    """The touches from which an arm can be identified, and the initial tool point.

    Args:
        series: joint values (m_i, n) of each point.
        arm: nominal.
        tcp: (3,) [m] initial tool point; by default that of `first_tcp`.

    Raises:
        ConfigurationError: as for `checked_series`; there are too few touches; no joint moves over
            them.
    """
    series = checked_series(series, arm)
    places_used, warnings = without_repeats(series)
    live = [i for i, places in enumerate(places_used) if len(places)]
    used = [series[i][places_used[i]] for i in live]

    if sum(len(q) - 1 for q in used) < 2:
        raise ConfigurationError(
            "series: at least one point must be touched at least three times in different poses, "
            "got " + ", ".join(str(len(places)) for places in places_used)
        )
    if not any(moved(q, arm).any() for q in used):
        raise ConfigurationError(
            "series: at least one joint must move by a degree over the touches of a point; touches "
            "in one posture do not identify an arm"
        )
    start = first_tcp(arm, used) if tcp is None else checked(tcp, (3,), "tcp")
    return UsableTouches(
        series=series, kept=places_used, live=live, tcp=start, warnings=tuple(warnings)
    )


def checked_series(series: Sequence[ArrayLike], arm: SerialArm) -> list[Array]:
    """Validate the series: finite arrays (m_i, n), one column per joint, in radians and metres.

    Raises:
        ConfigurationError: a value is invalid, for instance an angle in degrees; the message names
            series, touch and joint.
    """
    if isinstance(series, np.ndarray) and series.ndim == 2:
        raise ConfigurationError(
            "series: expected a list of arrays (m_i, n), one per touched point, got one array"
        )
    if isinstance(series, str | bytes | Mapping) or not isinstance(series, Iterable):
        raise ConfigurationError(
            "series: expected a list of arrays (m_i, n), one per touched point, got "
            f"{shown(series)}"
        )

    series = list(series)
    if len(series) == 0:
        raise ConfigurationError("series: must have at least one series of touches, got none")

    out = []
    for i, values in enumerate(series):
        q = real_array(values, f"series {i + 1}", f"joint values (m, {arm.n})")
        if q.size == 0:
            raise ConfigurationError(f"series {i + 1}: must have at least one touch, got none")
        if q.ndim != 2 or q.shape[1] != arm.n:
            raise ConfigurationError(
                f"series {i + 1}: the arm has {arm.n} joints, so the shape must be (m, {arm.n}), "
                f"got {q.shape}"
            )

        bad = np.argwhere(~np.isfinite(q))
        if len(bad):
            j, k = bad[0]
            raise ConfigurationError(
                f"series {i + 1}, touch {j + 1}: joint {k + 1} is {q[j, k]}, not a finite number"
            )

        far = np.abs(q[:, arm.slides])
        if far.size and far.max() > _LONGEST_SLIDE:
            raise ConfigurationError(
                f"series {i + 1}: slides must be in metres, got {far.max():.4g}, which looks like "
                "millimetres"
            )
        out.append(q)

    _refuse_degrees(out, arm)
    return out


def _refuse_degrees(series: list[Array], arm: SerialArm) -> None:
    hinges = ~arm.slides
    if not hinges.any():
        return
    largest = max(float(np.abs(q[:, hinges]).max()) for q in series)
    if largest <= 0.5 * _TWO_TURNS:
        return

    i = int(np.argmax([np.abs(q[:, hinges]).max() for q in series]))
    message = f"series {i + 1}: a joint angle of {largest:.4g} rad"
    if largest > _TWO_TURNS:
        raise ConfigurationError(
            f"{message}; these look like degrees, radians are needed (numpy.deg2rad)"
        )

    # Within two turns, the unit with which the touches of a point are closer together.
    turned = [np.where(hinges, np.deg2rad(q), q) for q in series]
    as_radians, as_degrees = (
        spread(arm, first_tcp(arm, q_series), q_series) for q_series in (series, turned)
    )
    if as_degrees < as_radians / _FIT_BETTER:
        raise ConfigurationError(
            f"{message}; the touches of a point lie {1e3 * as_degrees:.3g} mm about it if read as "
            f"degrees and {1e3 * as_radians:.3g} mm as radians: they look like degrees, radians "
            "are needed (numpy.deg2rad)"
        )


def motions(q: Array) -> Array:
    """RMS motion (n,) [rad] or [m] of each joint about its mean over the touches `q` (m, n)."""
    return np.sqrt(np.mean((q - q.mean(axis=0)) ** 2, axis=0))


def moved(q: Array, arm: SerialArm) -> np.ndarray:
    """Mask (n,) of the joints that move enough over the touches `q` (m, n) to be identified."""
    return motions(q) > np.where(arm.slides, STILL_SHARE * arm.reach, STILL)


def first_tcp(arm: SerialArm, series: Sequence[Array]) -> Array:
    """Initial tool point (3,) [m] in the flange: linear least squares per series, then their mean.

    After [Yukhimets 2023, eq. 13-16]. Eq. (13) reads X_f + [R_f E] Lambda = 0, so that Lambda =
    -(Omega^T Omega)^-1 Omega^T X_f; eq. (15) as printed lacks the minus. Directions that the
    orientations of a series do not determine are set to zero.
    """
    estimates = []
    for q in series:
        if len(q) < 2:
            continue

        # R tcp + p = c in every touch: linear in the tool point and the touched point c.
        X = arm.flange(q)
        Omega = np.concatenate(
            [X[:, :3, :3], np.broadcast_to(np.eye(3), (len(q), 3, 3))], axis=2
        ).reshape(-1, 6)
        estimates.append(np.linalg.lstsq(Omega, -X[:, :3, 3].ravel(), rcond=1e-3)[0][:3])

    return np.mean(estimates, axis=0) if estimates else np.zeros(3)


def spread(arm: SerialArm, tcp: Array, series: Sequence[Array]) -> float:
    """RMS distance [m] of the tips from the mean of their series.

    Args:
        arm: kinematics.
        tcp: (3,) [m] tool point in the flange.
        series: joint values (m_i, n) per point.

    Returns:
        The distance over all touches.
    """
    square = 0.0
    count = 0
    for q in series:
        p = arm.tips(q, tcp)
        square += float(np.sum((p - p.mean(axis=0)) ** 2))
        count += len(q)

    return np.sqrt(square / count)


def without_repeats(series: Sequence[Array]) -> tuple[list[np.ndarray], list[str]]:
    """Indices of the informative touches per series, and a message about each series from which
    touches were left out.

    A touch that is written twice is used once, since its copy has no noise of its own. A series of
    a single touch is left out.
    """
    places_used = []
    lines = []
    for i, q in enumerate(series):
        rounded = np.round(q / _SAME)
        places = np.sort(np.unique(rounded, axis=0, return_index=True)[1])

        if len(places) < len(q):
            lines.append(
                f"series {i + 1}: {len(q) - len(places)} of {len(q)} touches left out, since they "
                "repeat another exactly"
            )
        if len(places) < 2:
            lines.append(
                f"series {i + 1}: left out, since a single touch of a point does not constrain the "
                "arm"
            )
            places = places[:0]
        places_used.append(places)

    return places_used, lines
