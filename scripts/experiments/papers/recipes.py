"""Recipes to pass a singular configuration: those of [Danilov 2021, ch. 4], and of this project."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from uuv.controllers.ik.tracking import Passing
from uuv.controllers.mkps import Chain, Method, Track, track
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, rotation_angle

NARROW = np.deg2rad(80.0)
OFF = 1e-4  # [m] and
TURNED = 1e-3  # [rad] from which on the tool counts as off its path


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Options of `uuv.controllers.mkps.track`, and limits of the wrist."""

    passing: Passing = "limit"
    spare_joints: bool = False
    hold_joint: int | None = None
    narrow: bool = False  # joints 5 and 6 within 80 deg


WITHOUT, DEFAULT, NARROWED = "without", "default", "paper, 5 and 6 within 80 deg"
RECIPES: dict[str, Recipe] = {
    WITHOUT: Recipe(passing="off"),
    NARROWED: Recipe(narrow=True),
    "paper, joint 1 held": Recipe(passing="hold", hold_joint=0),
    "limit": Recipe(),
    "hold": Recipe(passing="hold"),
    "auto": Recipe(passing="auto"),
    DEFAULT: Recipe(spare_joints=True),
}


@dataclass(frozen=True, kw_only=True)
class RecipePath:
    """Poses of the tool, one a period, and the speed limit of the joints."""

    poses: Array  # (N, 4, 4)
    q0: Array  # (n,) [rad] one period before the first
    period: float  # [s]
    speed_limit: float  # [rad/s]


class TipErrors(NamedTuple):
    """Errors of the tip along a path, by the arm's own kinematics, independent of the solver."""

    position: Array  # (N,) [m]
    orientation: Array  # (N,) [rad]

    @property
    def share_off(self) -> float:
        """Share of the poses at which the tool is off its path."""
        return float(np.mean((self.position > OFF) | (self.orientation > TURNED)))


def tip_errors(arm: PublishedArm, run: Track, path: Array) -> TipErrors:
    """Errors of a run along the poses `path` (N, 4, 4)."""
    tips = np.array([arm.joint_frames(q)[-1] for q in run.q])
    turned = [rotation_angle(a[:3, :3], b[:3, :3]) for a, b in zip(tips, path, strict=True)]
    off = np.linalg.norm(tips[:, :3, 3] - path[:, :3, 3], axis=1)
    return TipErrors(position=off, orientation=np.array(turned))


def line(X: Array, along: Array, reach: float, step: float, beside: Array | float = 0.0) -> Array:
    """Tip poses (N, 4, 4) of a straight line without turning, through or beside X (4, 4).

    Args:
        X: Pose of the tip.
        along: (3,) unit direction.
        reach: [m] before and after the middle.
        step: [m] between poses.
        beside: (3,) [m] from X to the line's middle.

    Raises:
        ConfigurationError: The line is shorter than a step.
    """
    # An even number, so that the middle is one of the poses
    steps = 2 * round(reach / step)
    if steps < 2:
        raise ConfigurationError(
            f"--reach: must be at least --speed times --period, {step:g} m, got {reach:g}"
        )

    offsets = np.linspace(-reach, reach, steps + 1)[:, None] * along + beside
    return np.array([pose(X[:3, :3], X[:3, 3] + offset) for offset in offsets])


def begun(chain: Chain, back: Array, q: Array, period: float, **options: Any) -> Array:
    """Joint values (n,) at the beginning of a path, found by tracking it back from its middle.

    Args:
        chain: The arm.
        back: (N, 4, 4) poses from the middle to the beginning.
        q: (n,) [rad] in the middle.
        period: [s] between poses.
        **options: Of `uuv.controllers.mkps.track`.

    Raises:
        ConfigurationError: The arm does not come back in time.
    """
    run = track(chain, back, q, period, spare_joints=False, **options)

    if not run.converged[-1]:
        raise ConfigurationError(
            f"--reach, --speed: the arm does not reach the beginning of its path in "
            f"{period * len(back):g} s"
        )
    return np.array(run.q[-1])


def tracked(arm: PublishedArm, path: RecipePath, name: str, method: Method) -> Track:
    """Run of an arm along a path by the recipe of a name and a method."""
    recipe = RECIPES[name]
    return track(
        Chain.from_arm(narrowed(arm, path.q0) if recipe.narrow else arm),
        path.poses,
        path.q0,
        path.period,
        speed_limits=path.speed_limit,
        passing=recipe.passing,
        method=method,
        hold_joint=recipe.hold_joint,
        spare_joints=recipe.spare_joints,
    )


def narrowed(arm: PublishedArm, q0: Array) -> PublishedArm:
    """`arm` with joints 5 and 6 within 80 deg, or as far as `q0` (n,) [rad] is out."""
    limits = np.array(arm.limits)
    for joint in (4, 5):
        most = max(NARROW, abs(float(q0[joint])))
        limits[joint] = np.clip(limits[joint], -most, most)

    return replace(arm, limits=limits)
