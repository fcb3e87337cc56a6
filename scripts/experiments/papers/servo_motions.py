"""Poses of the eight-joint servo arm in the experiments of [Danilov 2021, ch. 4], as solved by each
method.
"""

import math
from functools import cache

import numpy as np

from uuv.controllers.mkps import Chain, IkOptions, IkResult, Method, solve
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

# x, y, z [mm], course, trim, roll [deg]
INITIAL = np.array([-11.8, -498.9, -73.4, 239.782, 272.244, 239.270])
GIVEN = np.array([100.0, -400.0, 0.0, 5.0, -50.0, 0.0])  # the same, second row of table 1
SOLVED = np.array([99.5, -399.4, -0.3, 5.074, -50.491, -0.138])  # third row of table 1
# fourth row; y and z by the measuring scheme of fig. 10
MEASURED = np.array([89.0, 95.0, 66.0, 3.0, -45.0, 2.0])
UP = (0.0, 1.0, 0.0)  # y
POSITION, ANGLE = 1e-3, 1e-2  # [m], [rad] published accuracy of each goal
ALONG_X = (100.0, -100.0)  # [mm] first and last x of experiment 2
IN_TRIM = (-50.0, -10.0)  # [deg] first and last trim of experiment 3
DEFAULT: Method = "hybrid"
METHODS: tuple[Method, ...] = ("plain", "jacobian_free", DEFAULT)
# by motion: varied entry of the row of table 1, its first and last value
MOTIONS = {"along x": (0, ALONG_X), "in trim": (4, IN_TRIM)}


@cache
def servo_chain() -> Chain:
    """The arm."""
    arm = published_arms.SERVO_ARM
    return Chain.from_vectors(arm.M, arm.e, arm.p, arm.L)


def tool_pose(row: Array) -> Array:
    """Pose (4, 4) of the tip for a row of table 1.

    The published E_x is along the tool and E_z across it; ours are z and x.
    """
    course, trim, roll = np.radians(row[3:])
    R = exp_so3([0.0, course, 0.0]) @ exp_so3([0.0, 0.0, trim]) @ exp_so3([roll, 0.0, 0.0])

    # From the published axes to ours.
    return pose(np.column_stack([R[:, 2], np.cross(R[:, 0], R[:, 2]), R[:, 0]]), 1e-3 * row[:3])


def row_of(X: Array) -> Array:
    """The row of table 1 for a pose, inverse of `tool_pose`; angles in (-180, 180] deg, trim in
    [-90, 90] deg.
    """
    R = np.column_stack([X[:3, 2], np.cross(X[:3, 0], X[:3, 2]), X[:3, 0]])

    # Angles about y, then z, then x.
    course = math.atan2(-R[2, 0], R[0, 0])
    trim = math.atan2(R[1, 0], math.hypot(R[0, 0], R[2, 0]))
    roll = math.atan2(-R[1, 2], R[1, 1])
    return np.array([*(1e3 * X[:3, 3]), *np.degrees([course, trim, roll])])


def solved(row: Array, q: Array, method: Method, *, track: bool) -> IkResult:
    """Solves for one row of table 1 with the published accuracies.

    Args:
        row: x, y, z [mm], course, trim, roll [deg].
        q: (n,) [rad] start.
        method: Method of the solver.
        track: Keep the branch of the start.
    """
    return solve(
        servo_chain(),
        tool_pose(row),
        q,
        POSITION,
        ANGLE,
        method=method,
        branch="keep" if track else "free",
        options=IkOptions(history=True, stage_tolerances=(ANGLE, ANGLE)),
    )


def single_solution(method: Method) -> IkResult:
    """Experiment 1; all methods start from the same joint values, solved to a tight tolerance."""
    chain = servo_chain()
    q = np.array(solve(chain, tool_pose(INITIAL), np.full(chain.n, 0.1), 1e-6, 1e-6).q)
    return solved(GIVEN, q, method, track=False)


def motion_start() -> Array:
    """Joint values (n,) [rad] at the row that was given, by the default method's branch."""
    start = single_solution(DEFAULT).q
    return np.array(solve(servo_chain(), tool_pose(GIVEN), start, 1e-6, 1e-6).q)


def motion_values(name: str, poses: int) -> Array:
    """Values of the varied entry of a motion."""
    first, last = MOTIONS[name][1]
    return np.linspace(first, last, poses)


def motion(name: str, poses: int, method: Method) -> list[IkResult]:
    """A motion of MOTIONS, each pose from the result before."""
    rows = np.tile(GIVEN, (poses, 1))
    rows[:, MOTIONS[name][0]] = motion_values(name, poses)

    # Each pose from the joint values of the one before.
    q = motion_start()
    results = []
    for row in rows:
        results.append(solved(row, q, method, track=True))
        q = np.array(results[-1].q)
    return results


def goals_of(result: IkResult) -> Array:
    """The three goals (iterations + 1, 3) of a result of `solved`."""
    assert result.goals is not None
    return result.goals
