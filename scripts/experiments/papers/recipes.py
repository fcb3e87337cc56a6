"""Recipes to pass a singular configuration: those of [Danilov 2021, ch. 4], and of this project."""

from dataclasses import dataclass, replace

import numpy as np

from uuv.controllers.ik.tracking import Passing
from uuv.controllers.mkps import Chain, Method, Track, track
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.spatial import Array

NARROW = np.deg2rad(80.0)


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
