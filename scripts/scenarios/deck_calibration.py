"""The arm of a vehicle calibrated on deck, before the dive: touches with a hand's noise, or an arm from a file."""

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from calib import Calibration, identify, simulation
from calib.arm import Arm
from calib.arm_files import of_geometry, read_arm, to_geometry
from models.arms.dh_geometry import ArmGeometry
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.spatial import Array

POINTS, TOUCHES = 4, 21  # how many points are touched, and how often each
HAND = 1e-4  # [m] deviation of a touch along each axis
LENGTH_ERROR = 5e-5  # [m] deviation of the one known distance
CONE = np.deg2rad(60.0)  # [rad] of the tool about the way down
PLACES_TRIED = 2000
OWN_TOOL = 0.03  # [m] from the nominal tip, within which a tool is the vehicle's own
DOWN = (0.0, 0.0, 1.0)  # in the arm's base, whose z points away from the hull


def farthest(points: Array) -> tuple[int, int]:
    """The two of `points` (k, 3) that are farthest apart."""
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
    i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
    return int(min(i, j)), int(max(i, j))


def touched(
    arm: Arm,
    tcp: Array,
    limits: Array,
    rng: np.random.Generator,
    *,
    points: int = POINTS,
    touches: int = TOUCHES,
    noise: float = HAND,
    way: ArrayLike = DOWN,
) -> tuple[list[Array], Array]:
    """Touches (m, n) [rad] by the arm as built, one array a point, and the true points (k, 3) [m] in its base.

    Points are drawn where the arm reaches with its flange about `way` (3,), well apart. Raises ReachError if there are
    no such.
    """
    bounds = np.clip(limits, -np.pi, np.pi)
    apart = 0.25 * (arm.reach + float(np.linalg.norm(tcp)))
    series: list[Array] = []
    places: list[Array] = []
    for _ in range(PLACES_TRIED):
        q = rng.uniform(bounds[:, 0], bounds[:, 1])
        place = arm.tips(q[None], tcp)[0]
        # The flange's own direction is left to the touches; a place that is reached with joints to spare takes many.
        if any(float(np.linalg.norm(place - other)) < apart for other in places):
            continue
        if arm.flange(q[None])[0, :3, 2] @ np.asarray(way) < np.cos(CONE):
            continue
        try:
            series += simulation.touch(
                arm, tcp, rng, points=place[None], touches=touches, noise=noise, approach=way, limits=bounds, cone=CONE
            )
        except ReachError:
            continue
        places.append(place)
        if len(places) == points:
            return series, np.array(places)
    raise ReachError(f"the arm reaches {len(places)} places from {touches} directions each; {points} are needed")


def on_deck(believed: ArmGeometry, built: ArmGeometry, rng: np.random.Generator) -> tuple[ArmGeometry, str]:
    """The arm as identified from touches of the built one, and what to say of it in a line."""
    series, places = touched(of_geometry(built), np.zeros(3), built.limits, rng)
    i, j = farthest(places)
    length = float(np.linalg.norm(places[i] - places[j])) + LENGTH_ERROR * rng.standard_normal()
    found = identify(series, of_geometry(believed), distances=[(i, j, length, LENGTH_ERROR)])
    return to_geometry(found.arm, found.tcp, believed), in_a_line(found, length)


def in_a_line(found: Calibration, length: float) -> str:
    """What a calibration found, for the terminal."""
    touches = sum(len(each) for each in found.residuals)
    before, after = (1e3 * np.sqrt(cost / max(_pairs(found), 1)) for cost in (found.cost_nominal, found.cost))
    return (
        f"arm calibrated on deck: {touches} touches of {len(found.residuals)} points and one length of {length:.2f} m; "
        f"pairs {before:.2f} mm apart before, {after:.2f} after; {found.rank.rank} of {found.rank.total} directions "
        "seen"
    )


def _pairs(found: Calibration) -> int:
    return sum(len(each) * (len(each) - 1) // 2 for each in found.residuals)


def from_file(file: Path, believed: ArmGeometry) -> tuple[ArmGeometry, str]:
    """The arm of a file that `calibrate_arm.py` wrote, for a vehicle whose arm is `believed`, and a line about it.

    Raises ConfigurationError if it has other joints.
    """
    source = read_arm(file)
    if source.joint_names != believed.joint_names:
        raise ConfigurationError(
            f"--arm {file}: joints {', '.join(source.joint_names)}; the vehicle has {', '.join(believed.joint_names)}"
        )
    aside = float(np.linalg.norm(source.tcp))
    if aside > OWN_TOOL:
        raise ConfigurationError(
            f"--arm {file}: touched with a tool whose tip is {1e3 * aside:.0f} mm from the vehicle's own; at most "
            f"{1e3 * OWN_TOOL:.0f} mm is taken for the same tool"
        )
    return to_geometry(source.arm, source.tcp, believed), f"arm of {file}"
