"""Published arms as Denavit-Hartenberg tables, for tests of inverse kinematics and calibration.

    arm = published_arms.load("panda")
    chain = Chain.from_arm(arm)

Rows are standard: theta0 [rad], d [m], a [m], alpha [rad] (`uuv.models.arms.serial_arm`, beta
zero). Tables that were published in Craig's convention are converted. This conversion turns the tip
about its own axis, or the base, by a quarter or half turn.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from uuv.models.arms.serial_arm import SerialArm
from uuv.models.registry import Registry
from uuv.sim.interfaces.spatial import Array, pose, readonly

H = math.pi / 2
_Rows = list[tuple[float, float, float, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PublishedArm(SerialArm):
    """A serial arm whose numbers are published, with their source."""

    title: str = ""
    source: str = ""  # source of the numbers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VectorArm:
    """Serial arm as the vector model of [Danilov 2021, chapter 2, fig. 1] in its initial pose.
    Arrays are read-only.
    """

    title: str
    M: Array  # (n, 3) [m] link vectors
    e: Array  # (n, 3) joint axes
    p: Array  # (n,) kinds: 1 hinge, 0 slide, 2 pantograph link
    L: Array  # (2, n) row of lower limits, row of upper limits [rad] or [m]
    source: str


def available() -> tuple[str, ...]:
    """Names that `load` accepts."""
    return ARMS.names()


def load(name: str) -> PublishedArm:
    """Return the published arm of a name.

    Raises:
        ConfigurationError: no arm has that name; the message lists those that exist.
    """
    return ARMS.load(name)


def _arm(
    title: str,
    rows: _Rows,
    limits: Sequence[tuple[float, float]],
    source: str,
    *,
    joint_types: str | None = None,
    p_tool: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> PublishedArm:
    """Arm of DH rows; `limits` in degrees (slides: m), `p_tool` [m] the tip in the last frame."""
    arm = PublishedArm.from_dh(rows, joint_types)
    return replace(
        arm,
        title=title,
        limits=readonly(np.where(arm.slides[:, None], limits, np.radians(limits))),
        X_n_flange=readonly(pose(p=p_tool)),
        source=source,
    )


_CORKE = "P. Corke, Robotics Toolbox for Python, models.DH"
_PUMA: _Rows = [
    (0, 0.67183, 0, H),
    (0, 0, 0.4318, 0),
    (0, 0.15005, 0.0203, -H),
    (0, 0.4318, 0, H),
    (0, 0, 0, -H),
    (0, 0, 0, 0),
]
_PUMA_LIMITS = [
    (-160.0, 160.0),
    (-45.0, 225.0),
    (-225.0, 45.0),
    (-110.0, 170.0),
    (-100.0, 100.0),
    (-266.0, 266.0),
]
_FREE = (-math.inf, math.inf)

_ARMS = {
    "puma560": _arm("PUMA 560", _PUMA, _PUMA_LIMITS, f"{_CORKE}.Puma560"),
    "puma560_tool": _arm(
        "PUMA 560, tool",
        _PUMA,
        _PUMA_LIMITS,
        f"{_CORKE}.Puma560; the tool is invented and lies off the wrist's axis",
        p_tool=(0.05, 0.03, 0.2),
    ),
    "stanford": _arm(
        "Stanford",
        [
            (0, 0.412, 0, -H),
            (0, 0.154, 0, H),
            (-H, 0, 0.0203, 0),
            (0, 0, 0, -H),
            (0, 0, 0, H),
            (0, 0, 0, 0),
        ],
        [*[(-170.0, 170.0)] * 2, (0.3048, 1.27), (-170.0, 170.0), (-90.0, 90.0), (-170.0, 170.0)],
        f"{_CORKE}.Stanford",
        joint_types="rrprrr",
    ),
    "ur5": _arm(
        "UR5",
        [
            (0, 0.089159, 0, H),
            (0, 0, -0.425, 0),
            (0, 0, -0.39225, 0),
            (0, 0.10915, 0, H),
            (0, 0.09465, 0, -H),
            (0, 0.0823, 0, 0),
        ],
        [(-360.0, 360.0)] * 6,
        "Universal Robots, DH parameters for calculations of kinematics and dynamics",
    ),
    "ur10e": _arm(
        "UR10e",
        [
            (0, 0.1807, 0, H),
            (0, 0, -0.6127, 0),
            (0, 0, -0.57155, 0),
            (0, 0.17415, 0, H),
            (0, 0.11985, 0, -H),
            (0, 0.11655, 0, 0),
        ],
        [(-360.0, 360.0)] * 6,
        "Universal Robots, DH parameters for calculations of kinematics and dynamics",
    ),
    "irb140": _arm(
        "IRB 140",
        [
            (0, 0.352, 0.07, -H),
            (0, 0, 0.36, 0),
            (0, 0, 0, -H),
            (0, 0.38, 0, H),
            (0, 0, 0, -H),
            (0, 0.065, 0, 0),
        ],
        [
            (-180.0, 180.0),
            (-100.0, 100.0),
            (-220.0, 60.0),
            (-200.0, 200.0),
            (-120.0, 120.0),
            (-400.0, 400.0),
        ],
        f"{_CORKE}.IRB140",
    ),
    "general6r": _arm(
        "general 6R",
        [
            (0.1, 0.3, 0.1, 1.2),
            (0.2, 0.1, 0.4, -0.4),
            (0.3, 0.15, 0.35, 1.0),
            (-0.2, 0.2, 0.1, -1.3),
            (0.4, 0.1, 0.15, 1.1),
            (0.1, 0.12, 0.05, 0),
        ],
        [(-180.0, 180.0)] * 6,
        "invented: no two axes intersect or are parallel, so there is no closed-form solution",
    ),
    "panda": _arm(
        "Panda",
        [
            (0, 0.333, 0, -H),
            (0, 0, 0, H),
            (0, 0.316, 0.0825, H),
            (0, 0, -0.0825, -H),
            (0, 0.384, 0, H),
            (0, 0, 0.088, H),
            (0, 0.107, 0, 0),
        ],
        [
            (-166.0, 166.0),
            (-101.0, 101.0),
            (-166.0, 166.0),
            (-176.0, -4.0),
            (-166.0, 166.0),
            (-1.0, 215.0),
            (-166.0, 166.0),
        ],
        "Franka Emika, Franka Control Interface, Denavit-Hartenberg parameters (Craig's convention "
        "in the source)",
    ),
    "iiwa7": _arm(
        "LBR iiwa 7",
        [
            (0, 0.34, 0, -H),
            (0, 0, 0, H),
            (0, 0.4, 0, H),
            (0, 0, 0, -H),
            (0, 0.4, 0, -H),
            (0, 0, 0, H),
            (0, 0.126, 0, 0),
        ],
        [
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-170.0, 170.0),
            (-120.0, 120.0),
            (-175.0, 175.0),
        ],
        "KUKA, LBR iiwa 7 R800, technical data",
    ),
    "gen3": _arm(
        "Kinova Gen3",
        [
            (0, -0.2848, 0, H),
            (math.pi, -0.0118, 0, H),
            (math.pi, -0.4208, 0, H),
            (math.pi, -0.0128, 0, H),
            (math.pi, -0.3143, 0, H),
            (math.pi, 0, 0, H),
            (math.pi, -0.1674, 0, math.pi),
        ],
        [_FREE, (-128.9, 128.9), _FREE, (-147.8, 147.8), _FREE, (-120.3, 120.3), _FREE],
        "Kinova, Gen3 user guide, classical DH parameters of the 7 DOF spherical arm, after the "
        "fixed first row",
    ),
    "xarm7": _arm(
        "xArm 7",
        [
            (0, 0.267, 0, -H),
            (0, 0, 0, H),
            (0, 0.293, 0.0525, H),
            (0, 0, 0.0775, H),
            (0, 0.3425, 0, H),
            (0, 0, 0.076, -H),
            (0, 0.097, 0, 0),
        ],
        [
            (-360.0, 360.0),
            (-118.0, 120.0),
            (-360.0, 360.0),
            (-11.0, 225.0),
            (-360.0, 360.0),
            (-97.0, 180.0),
            (-360.0, 360.0),
        ],
        "UFACTORY, xArm user manual, DH parameters",
    ),
    "baxter": _arm(
        "Baxter",
        [
            (0, 0.27, 0.069, -H),
            (H, 0, 0, H),
            (0, 0.364, 0.069, -H),
            (0, 0, 0, H),
            (0, 0.374, 0.01, -H),
            (0, 0, 0, H),
            (0, 0.28, 0, 0),
        ],
        [
            (-97.5, 97.5),
            (-123.0, 60.0),
            (-175.0, 175.0),
            (-2.9, 150.0),
            (-175.3, 175.3),
            (-90.0, 120.0),
            (-175.3, 175.3),
        ],
        f"{_CORKE}.Baxter; limits by Rethink Robotics, Baxter hardware specifications",
    ),
    "era": _arm(
        "European Robotic Arm",
        [
            (0, 1.228, 0, H),
            (H, 0, 0.34, H),
            (0, 0, 4.072, 0),
            (0, 0, 4.072, 0),
            (0, 0, 0.34, -H),
            (H, 0, 0, H),
            (0, 1.228, 0, 0),
        ],
        [(-180.0, 180.0), *[(-135.0, 135.0)] * 5, (-180.0, 180.0)],
        "link lengths and limits: S. M. Persson, ReaK, manip_ERA_arm.hpp; joints by ESA: "
        "roll, yaw, pitch at the shoulder, pitch at the elbow, pitch, yaw, roll at the wrist; "
        "straight at zero, 11.28 m (ESA: 11.3 m)",
    ),
}

# The maker's own angles: joints 2 and 3 are at 180 deg when the arm points straight up.
_JACO_D = (0.2755, 0.41, 0.2073, 0.0743, 0.0743, 0.1687)  # [m] D1 to D6
# [rad] of the wrist, whose axes are inclined by 60 deg
_JACO_BEND = math.sin(H / 3.0) / math.sin(2.0 * H / 3.0)
_ARMS["jaco"] = _arm(
    "Kinova Jaco",
    [
        (0, _JACO_D[0], 0, H),
        (-H, 0, _JACO_D[1], math.pi),
        (H, -0.0098, 0, H),
        (0, -_JACO_D[2] - _JACO_BEND * _JACO_D[3], 0, 2.0 * H / 3.0),
        (-math.pi, -_JACO_BEND * (_JACO_D[3] + _JACO_D[4]), 0, 2.0 * H / 3.0),
        (math.radians(100.0), -_JACO_BEND * _JACO_D[4] - _JACO_D[5], 0, math.pi),
    ],
    [_FREE, (47.0, 313.0), (19.0, 341.0), *[_FREE] * 3],
    "P. Corke, Robotics Toolbox for MATLAB, mdl_jaco.m, after Kinova's table of 2013; limits: "
    "Kinova, Jaco user guide, not symmetric about zero",
)

_TURN = (0.0, 1.0, 0.0)
_TILT_X = (1.0, 0.0, 0.0)
_TILT_Z = (0.0, 0.0, 1.0)
SERVO_ARM = VectorArm(
    title="eight-joint servo arm",
    M=readonly(np.outer([0.06, 0.07, 0.07, 0.07, 0.07, 0.07, 0.06, 0.06], (0.0, -1.0, 0.0))),
    e=readonly([_TURN, _TILT_Z, _TILT_X, _TILT_Z, _TURN, _TILT_X, _TURN, _TILT_Z]),
    p=readonly(np.ones(8)),
    L=readonly(np.radians(np.outer([-120.0, 120.0], np.ones(8)))),
    source=(
        "replaces the arm of [Danilov 2021, fig. 8], whose dimensions are not public. It hangs "
        "straight down (y up) at zero and is 0.53 m long, so that it reaches the poses of table 1 "
        "there. Links, axes and limits are invented"
    ),
)

ARMS: Registry[PublishedArm] = Registry(
    "arm", {name: partial(_ARMS.__getitem__, name) for name in _ARMS}
)
