"""First demonstration of SIMURV 4.0, followed by the priorities here and by those of SIMURV.

The tool of PHOENIX with its SMART-3S goes from the zero posture to (1.6, -0.2, 1.9) m in 6 s and
turns over by 180 degrees in 12 s [Antonelli 2013]; data and formulas read in
SIAEthen/simurv_unicas, func/core_simulator_demo1.m. SIMURV moves hull and arm by weighted
pseudo-inverses, one for each task: the tool's pose, a level hull, the second joint at -45 degrees;
each speed is cut off at its limit. Axes are its own, z down.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.controllers.ik.chain import Chain
from uuv.controllers.mkps import solve
from uuv.controllers.planning.carried_arm import HULL_JOINTS, hull_pose, with_hull
from uuv.experiment import Page, column, experiment
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.vehicles import phoenix_smart3s
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose

GOAL = np.array([1.6, -0.2, 1.9])  # [m]
CRUISE, WAY_TIME = (0.3, 0.1, 0.6), 6.0  # [m/s] along x, y, z; [s]
TURN_CRUISE, TURN_TIME = 0.7, 12.0  # [rad/s], [s]
STEP, SECONDS = 0.01, 15.0  # [s]
# [1/s] of the tool, the level hull, and each joint
GAINS = 20.0, 10.0, np.array([0.0, 10.0, 0.0, 0.0, 0.0, 0.0])
WEIGHTS = np.repeat([50.0, 25.0, 1.0], [3, 3, 6])  # of the speeds of hull and joints
FASTEST = np.repeat([0.2, 0.2, np.radians(20.0)], [3, 3, 6])  # [m/s], [rad/s]
POSTURE = np.array([0.0, -0.25 * np.pi, 0.0, 0.0, 0.0, 0.0])  # [rad]
DAMPING = 1e-5  # where a task is singular
PoseOverTime = Callable[[float], Array]  # time [s] -> pose of the tool (4, 4)
DEGREES = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class DemonstrationCase:
    """One rule that follows the demonstration."""

    rule: str
    """Of motion: priorities, those of `uuv.controllers.mkps`, or pseudo-inverses, SIMURV's."""


@dataclass(frozen=True, kw_only=True)
class DemonstrationRow:
    """Largest errors, ways and largest speeds."""

    position: float = column("tool off", "mm", factor=1e3, tolerance=1e-3)
    angle: float = column("angle off", "deg", factor=DEGREES, tolerance=1e-3)
    way: float = column("hull", "m", digits=2)
    turn: float = column("hull turns", "deg", digits=0, factor=DEGREES)
    joints: float = column("joints, sum", "deg", digits=0, factor=DEGREES)
    speed: float = column("hull", "m/s", digits=2)
    joint_speed: float = column("joint", "deg/s", digits=0, factor=DEGREES)


def profile(way: float, cruise: float, duration: float, time: float) -> float:
    """Way of a trapezoidal speed profile at `time`; a cruise speed that does not fit is 1.5 times
    the mean.
    """
    mean = abs(way) / duration
    speed = np.sign(way) * (cruise if mean < cruise <= 2.0 * mean else 1.5 * mean)
    if not way or time >= duration:
        return way
    ramp = duration - way / speed
    rising = min(time, ramp)
    falling = max(0.0, time - (duration - ramp))
    return float(speed * (0.5 * rising**2 / ramp + max(0.0, time - ramp) - 0.5 * falling**2 / ramp))


def demonstration(X_from: Array) -> PoseOverTime:
    """Pose of the tool (4, 4) over time [s], from its pose at the start."""
    turn = log_so3(X_from[:3, :3].T)
    angle = float(np.linalg.norm(turn))
    way = GOAL - X_from[:3, 3]

    def target(time: float) -> Array:
        done = profile(angle, TURN_CRUISE, TURN_TIME, time) / angle
        gone = [
            profile(float(part), cruise, WAY_TIME, time)
            for part, cruise in zip(way, CRUISE, strict=True)
        ]
        return pose(X_from[:3, :3] @ exp_so3(done * turn), X_from[:3, 3] + gone)

    return target


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Hull, joints and tool over time."""

    X_WB: Array  # (k, 4, 4)
    q: Array  # (k, 6) [rad]
    X_WG: Array  # (k, 4, 4)


def by_priorities(arm: SerialArm, times: Array, target: PoseOverTime) -> Motion:
    """The whole chain, solved from one time to the next."""
    whole = with_hull(Chain.from_arm(arm), pose(p=phoenix_smart3s.BASE))
    q = np.zeros(whole.n)
    rows = []
    for time in times:
        q = solve(whole, target(time), q, 1e-5, 1e-4, "priority").q
        rows.append((hull_pose(q[:HULL_JOINTS]), q[HULL_JOINTS:], whole.forward(q)))
    return Motion(*(np.array(series) for series in zip(*rows, strict=True)))


def by_pseudo_inverses(arm: SerialArm, times: Array, target: PoseOverTime) -> Motion:
    """SIMURV's weighted task priorities, by Euler steps of the speeds."""
    X_WB = np.eye(4)
    q = np.zeros(6)
    of_tool, of_hull, of_joints = GAINS
    rows = []

    for time in times:
        frames = [X_WB @ pose(p=phoenix_smart3s.BASE) @ X for X in arm.joint_frames(q)]
        rows.append((X_WB.copy(), q.copy(), frames[-1]))
        R = X_WB[:3, :3]
        X = frames[-1]

        # Jacobian of the tool, and its error: of angles, the vector of a quaternion
        axes = np.array([*R.T, *(frame[:3, 2] for frame in frames[:-1])])
        points = np.array([*3 * [X_WB[:3, 3]], *(frame[:3, 3] for frame in frames[:-1])])
        linear = np.vstack([R.T, np.cross(axes, X[:3, 3] - points)])
        tool = np.vstack([linear.T, np.vstack([np.zeros((3, 3)), axes]).T])
        away = log_so3(target(time)[:3, :3] @ X[:3, :3].T)
        half = 0.5 * float(np.linalg.norm(away))
        off = np.concatenate([target(time)[:3, 3] - X[:3, 3], 0.5 * away * np.sinc(half / np.pi)])

        # Jacobian of roll and pitch
        pitch, roll = Rotation.from_matrix(R).as_euler("ZYX")[1:]
        level = np.zeros((2, 12))
        level[:, 3:6] = [
            [1.0, np.sin(roll) * np.tan(pitch), np.cos(roll) * np.tan(pitch)],
            [0, np.cos(roll), -np.sin(roll)],
        ]

        # the tool first, then a level hull in its null space, then the posture in that of both
        first = inverse_of(tool)
        both = np.vstack([tool, level])
        speeds = first @ (of_tool * off)
        speeds += (
            (np.eye(12) - first @ tool) @ inverse_of(level) @ (of_hull * np.array([-roll, -pitch]))
        )
        posture = np.concatenate([np.zeros(6), of_joints * (POSTURE - q)])
        speeds += (np.eye(12) - inverse_of(both) @ both) @ posture

        # a step of Euler, cut off at the limits
        speeds = np.clip(speeds, -FASTEST, FASTEST)
        X_WB = pose(R @ exp_so3(STEP * speeds[3:6]), X_WB[:3, 3] + STEP * R @ speeds[:3])
        q = q + STEP * speeds[6:]

    return Motion(*(np.array(series) for series in zip(*rows, strict=True)))


def inverse_of(J: Array) -> Array:
    """Weighted pseudo-inverse, damped where the task is singular."""
    across = J / WEIGHTS @ J.T
    damping = 0.0 if np.linalg.matrix_rank(J) == len(J) else DAMPING
    return (J / WEIGHTS).T @ np.linalg.inv(across + damping * np.eye(len(J)))


RULES = {"priorities": by_priorities, "pseudo-inverses": by_pseudo_inverses}


@experiment("simurv_demo", vary={"rule": tuple(RULES)}, quick={"rule": tuple(RULES)})
def simurv_demo(case: DemonstrationCase) -> DemonstrationRow:
    """Follows the demonstration by one rule."""
    a, alpha, d = phoenix_smart3s.DH.T
    arm = SerialArm.from_dh(np.column_stack([np.zeros_like(a), d, a, alpha]))
    times = np.linspace(0.0, SECONDS, round(SECONDS / STEP) + 1)
    target = demonstration(pose(p=phoenix_smart3s.BASE) @ arm.joint_frames(np.zeros(6))[-1])
    motion = RULES[case.rule](arm, times, target)

    # errors of the tool
    off = [np.linalg.inv(target(time)) @ X for time, X in zip(times, motion.X_WG, strict=True)]

    # steps of hull and joints
    steps = np.linalg.norm(np.diff(motion.X_WB[:, :3, 3], axis=0), axis=1)
    R = motion.X_WB[:, :3, :3]
    turns = [np.linalg.norm(log_so3(a.T @ b)) for a, b in pairwise(R)]
    joints = np.abs(np.diff(motion.q, axis=0))
    return DemonstrationRow(
        position=max(float(np.linalg.norm(X[:3, 3])) for X in off),
        angle=max(float(np.linalg.norm(log_so3(X[:3, :3]))) for X in off),
        way=float(steps.sum()),
        turn=float(np.sum(turns)),
        joints=float(joints.sum()),
        speed=float(steps.max()) / STEP,
        joint_speed=float(joints.max()) / STEP,
    )


simurv_demo.page = Page().table(
    "First demonstration of SIMURV: largest error, ways, largest speeds",
    by="rule",
    columns=["position", "angle", "way", "turn", "joints", "speed", "joint_speed"],
)

if __name__ == "__main__":
    run_scenario(simurv_demo.main)
