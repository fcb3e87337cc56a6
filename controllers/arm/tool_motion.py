"""Joint motion between the planner's steps, from tool pose to joint angles, compiled because of its
high rate.

One step extrapolates the tool pose, displaces it, and resolves it into the arm's base. MKPS solves
the inverse kinematics on the branch of the last angles, from where joints to spare have moved the
arm off singular postures and limits. Where six joints would spin beside a singular posture, they
turn at their speed limit, and the tool leaves its path by the least amount that this allows, as in
`uuv.controllers.ik.tracking`. The jump where the arm began to follow a tool pose is blended
out.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.arm.joint_servo import ResolvedMotion, ToolTarget, resolve_tool_motion
from uuv.controllers.ik.chain_kernels import (
    BAD_TARGET,
    HEAD,
    HYBRID,
    LOWER,
    UPPER,
    Settings,
    partition,
)
from uuv.controllers.ik.damped_descent import solve_keep
from uuv.controllers.ik.method import tracking_method
from uuv.controllers.ik.priorities import FULL
from uuv.controllers.ik.spare_joints import spare_motion
from uuv.controllers.ik.tracking import NEAR
from uuv.controllers.ik.tracking_solvers import solve_at, solver_address
from uuv.controllers.tuning import ArmTuning
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array

_POSITION = 1e-6  # [m] tolerance of the inverse kinematics
_ORIENTATION = 1e-5  # [rad] tolerance of the inverse kinematics
_STEPS = 4000  # [-] most iterations of the inverse kinematics
_PASSING_STEPS = 400  # [-] the same where a singular posture is passed


class ToolMotion(NamedTuple):
    """Desired joint motion, and the memory of its blending, as arrays that are changed in place."""

    q: Array  # (n,) [rad] desired angles of the last step
    qd: Array  # (n,) [rad/s]
    qdd: Array  # (n,) [rad/s^2] joint acceleration relative to one that moves with the hull
    yielding: Array  # (2, n) motion of the tip along its axis per joint, see `resolve_tool_motion`
    # (n,) [rad] remaining part of the jump at which the arm began to follow a tool pose
    offset: Array
    offset_rate: Array  # (n,) [rad/s]
    ik_error: Array  # (2,) [m, rad] errors of the last inverse kinematics; NaN before the first
    # (1,) bool: joint angles were held at the last step, and no tool pose was followed
    holding: np.ndarray
    # kernel memory of the arm's chain, which the inverse kinematics uses as working memory too
    chain: Array
    # the same where the tool must leave its path (`uuv.controllers.ik.tracking.passing_memory`)
    passing_chain: Array
    # (1,) bool: a singular posture is being passed
    passing: np.ndarray

    @classmethod
    def start(cls, q: Array, chain: Array, passing_chain: Array) -> "ToolMotion":
        """The arm held at `q` (n,) [rad]; `chain` and `passing_chain` are separate copies of the
        chain's kernel memories.
        """
        n = len(q)
        zeros = (np.zeros(n), np.zeros(n), np.zeros((2, n)), np.zeros(n), np.zeros(n))
        return cls(
            np.array(q),
            *zeros,
            ik_error=np.full(2, np.nan),
            holding=np.ones(1, dtype=np.bool_),
            chain=chain,
            passing_chain=passing_chain,
            passing=np.zeros(1, dtype=np.bool_),
        )


class ToolTracking(NamedTuple):
    """Arm, limits and period of `track_tool`."""

    X_AB: Array  # (4, 4) hull pose in the arm's base
    follows_hull: bool  # True: the joints also compensate the hull's velocity and acceleration
    speed_limit: float  # [rad/s] speed limit of every joint
    blend_time: float  # [s] see `ArmTuning`
    period: float  # [s]
    # address of the inverse kinematics (`uuv.controllers.ik.tracking_solvers`); 0: the hybrid
    # method
    solver: int
    spare_speed: float  # [rad/s] at which joints to spare move the arm; 0: it has none
    length: float  # [m] of the arm, by which nearness to singular postures is measured

    @classmethod
    def of(
        cls, X_AB: Array, joints: int, length: float, tuning: ArmTuning, *, follows_hull: bool
    ) -> "ToolTracking":
        """Record for an arm.

        Args:
            X_AB: (4, 4) hull pose in the arm's base.
            joints: number of joints.
            length: [m] of the arm.
            tuning: gains of the arm.
            follows_hull: as the field.
        """
        solver = solver_address(tracking_method(tuning.inverse_kinematics, joints))
        return cls(
            X_AB,
            follows_hull,
            tuning.joint_speed_limit,
            tuning.blend_time,
            tuning.task_period,
            solver,
            tuning.spare_joint_speed if joints > FULL else 0.0,
            length,
        )


@kernel
def hold_joints(motion, q, qd, since):
    """Hold or move joint angles.

    Args:
        motion: fields of `ToolMotion`, in a tuple; updated.
        q: (n,) [rad] angles desired `since` [s] ago.
        qd: (n,) [rad/s] joint speeds.
        since: [s] age of `q`.
    """
    motion = ToolMotion(*motion)
    for j in range(q.shape[0]):
        motion.q[j] = q[j] + since * qd[j]
        motion.qd[j] = qd[j]
        motion.qdd[j] = 0.0
    motion.holding[0] = True


@kernel
def track_tool(tracking, motion, target, since, displaced, X_WB, hull, tip):
    """Follow a tool pose.

    Args:
        tracking: fields of `ToolTracking`, in a tuple; likewise below.
        motion: `ToolMotion`; updated.
        target: `ToolTarget`, the tool motion desired `since` ago.
        since: [s] age of `target`.
        displaced: displacement along the tool axis [m], and further displacement (3,) [m] in W.
        X_WB: (4, 4) hull pose from which the arm places the tool.
        hull: (24,) motion of the hull as in `newton_euler`.
        tip: pose X_BG (4, 4) and Jacobian J_B (6, n) of the tip as it is, hull axes.

    Returns:
        False, with the motion unchanged, if the target is not a pose; and the tool pose (4, 4) in
            the arm's base.
    """
    track = ToolTracking(*tracking)
    out = ToolMotion(*motion)
    tool = ToolTarget(*target)
    n = out.q.shape[0]
    dt = track.period

    # Way off singular postures and limits, with the tool at rest
    spare = np.zeros(n)
    if track.spare_speed > 0.0:
        views = partition(out.chain, n)
        spare_motion(views.table, out.q, views.work, np.zeros((6, 6)), spare)
        for j in range(n):
            spare[j] *= track.spare_speed

    # Tool pose now, and the motion that it asks of the arm
    X_WG = extrapolated(tool.X_WG, tool.v_WG_W, tool.w_WG_W, since, displaced[0], displaced[1])
    resolved = ResolvedMotion(np.empty((4, 4)), np.empty(n), out.qdd, out.yielding)
    resolve_tool_motion(
        track.X_AB,
        X_WB,
        ToolTarget(X_WG, tool.v_WG_W, tool.w_WG_W),
        hull,
        tip,
        track.follows_hull,
        (track.speed_limit, spare),
        resolved,
    )

    # Joints to spare would integrate the offset that is blended out: they start where the arm would
    # stand without it
    start = out.q.copy()
    if track.spare_speed > 0.0:
        for j in range(n):
            start[j] += dt * spare[j] - (0.0 if out.holding[0] else out.offset[j])

    # Inverse kinematics on the branch of the last angles
    trail = out.chain[:0].reshape(0, 1)
    q = np.empty(n)
    if track.solver:
        errors = np.empty(2)
        code = solve_at(
            track.solver,
            out.chain,
            resolved.X_AG,
            start,
            (_POSITION, _ORIENTATION),
            _STEPS,
            q,
            errors,
        )
        error_p = errors[0]
        error_r = errors[1]
    else:
        settings = Settings(
            HYBRID, _POSITION, _ORIENTATION, _ORIENTATION, _ORIENTATION, _STEPS, 0, True, False
        )
        code, _, _, error_p, error_r = solve_keep(
            out.chain, resolved.X_AG, start, settings, None, trail, q
        )

    if code >= BAD_TARGET:
        return False, resolved.X_AG

    # the hull is slightly off the pose for which the held angles were computed
    if out.holding[0]:
        for j in range(n):
            out.offset[j] = out.q[j] - q[j]
            out.offset_rate[j] = out.qd[j] - resolved.qd[j]
        out.holding[0] = False
    elif n == FULL and not track.solver:
        error_p, error_r = _pass_singular(track, out, resolved, tip[1], (error_p, error_r), q)

    out.q[:], out.qd[:], out.offset[:], out.offset_rate[:] = bumpless(
        q,
        resolved.qd,
        out.q,
        out.offset,
        out.offset_rate,
        track.blend_time,
        track.speed_limit * dt,
        dt,
    )
    out.ik_error[0] = error_p
    out.ik_error[1] = error_r
    return True, resolved.X_AG


@kernel
def _pass_singular(track, out, resolved, J_B, errors, q):
    """Keep the speed limit beside a singular posture, the tool off its path by the least amount.

    Args:
        track: `ToolTracking`.
        out: `ToolMotion` of the last step; its `passing` is updated.
        resolved: `ResolvedMotion`; its `qd` is replaced where the posture is passed.
        J_B: (6, n) Jacobian of the tip as it is.
        errors: [m], [rad] of `q`.
        q: (n,) [rad] joint angles at the tool pose; replaced likewise.

    Returns:
        The errors [m], [rad] of the angles.
    """
    n = q.shape[0]
    most = track.speed_limit * track.period
    last = np.empty(n)
    fastest = 0.0
    for j in range(n):
        last[j] = out.q[j] - out.offset[j]
        fastest = max(fastest, abs(q[j] - last[j]))

    if fastest <= most:
        out.passing[0] = False
        return errors
    if not out.passing[0] and not _is_near(J_B, track.length):
        return errors
    out.passing[0] = True

    # Limits of this step
    limits = partition(out.chain, n).table
    steps = partition(out.passing_chain, n).table
    for j in range(n):
        lower = limits[HEAD + j, LOWER]
        upper = limits[HEAD + j, UPPER]
        last[j] = min(max(last[j], lower), upper)
        steps[HEAD + j, LOWER] = max(lower, last[j] - most)
        steps[HEAD + j, UPPER] = min(upper, last[j] + most)

    # The pose that leaves the path least, and the speeds that lead there
    trail = out.chain[:0].reshape(0, 1)
    settings = Settings(
        HYBRID, _POSITION, _ORIENTATION, _ORIENTATION, _ORIENTATION, _PASSING_STEPS, 0, True, False
    )
    beside = np.empty(n)
    code, _, _, error_p, error_r = solve_keep(
        out.passing_chain, resolved.X_AG, last, settings, None, trail, beside
    )
    if code >= BAD_TARGET:
        return errors
    for j in range(n):
        q[j] = beside[j]
        resolved.qd[j] = (beside[j] - last[j]) / track.period
    return error_p, error_r


@kernel
def _is_near(J, length):
    """True if a posture is near a singular one: the least singular value of its Jacobian (6, n),
    lengths over `length` [m], is under NEAR.
    """
    # it is above if the Gram matrix less its square has a Cholesky factor
    L = np.empty((6, 6))
    for a in range(6):
        for b in range(a + 1):
            total = -NEAR * NEAR if a == b else 0.0
            units = (1.0 / length if a < 3 else 1.0) * (1.0 / length if b < 3 else 1.0)
            for m in range(J.shape[1]):
                total += J[a, m] * J[b, m] * units
            for m in range(b):
                total -= L[a, m] * L[b, m]
            if a == b:
                if not total > 0.0:
                    return True
                L[a, a] = np.sqrt(total)
            else:
                L[a, b] = total / L[b, b]
    return False


@kernel
def extrapolated(X_WG, v_WG_W, w_WG_W, since, k, offset_W):
    """Extrapolate a tool pose by its velocities, then displace it along its axis and by an offset.

    Args:
        X_WG: (4, 4) tool pose `since` ago.
        v_WG_W: (3,) [m/s] velocity of its origin, W.
        w_WG_W: (3,) [rad/s] angular velocity, W.
        since: [s] age of `X_WG`.
        k: [m] displacement along the tool axis.
        offset_W: (3,) [m] further displacement, W.

    Returns:
        The pose (4, 4).
    """
    angle = since * np.sqrt(w_WG_W[0] ** 2 + w_WG_W[1] ** 2 + w_WG_W[2] ** 2)
    s = 1.0 - angle**2 / 6.0 if angle < 1e-6 else np.sin(angle) / angle  # Rodrigues
    c = 0.5 - angle**2 / 24.0 if angle < 1e-6 else (1.0 - np.cos(angle)) / angle**2
    x, y, z = since * w_WG_W[0], since * w_WG_W[1], since * w_WG_W[2]

    out = X_WG.copy()
    for j in range(3):
        a, b, d = X_WG[0, j], X_WG[1, j], X_WG[2, j]
        along = c * (x * a + y * b + z * d)
        direct = 1.0 - c * angle**2
        out[0, j] = direct * a + s * (y * d - z * b) + along * x
        out[1, j] = direct * b + s * (z * a - x * d) + along * y
        out[2, j] = direct * d + s * (x * b - y * a) + along * z

    for i in range(3):
        out[i, 3] += since * v_WG_W[i] + k * out[i, 2] + offset_W[i]
    return out


@kernel
def bumpless(q, qd, q_last, offset, offset_rate, blend_time, most, dt):
    """Bumpless transfer to a new joint reference, in which the remaining offset decays with
    critical damping.

    If one joint would move too far, all joints are slowed down by the same factor, because a single
    joint that lags would move the tool off its path, into the surface.

    Args:
        q: (n,) [rad] angles of the reference.
        qd: (n,) [rad/s] speeds of the reference.
        q_last: (n,) [rad] angles desired in the last step.
        offset: (n,) [rad] remaining offset from the reference.
        offset_rate: (n,) [rad/s] rate of the offset.
        blend_time: [s] time constant of the decay.
        most: [rad] largest change of an angle in this step.
        dt: [s] of this step.

    Returns:
        Desired angles and speeds, remaining offset and its rate, (n,) each.
    """
    n = q.shape[0]
    angle = np.empty(n)
    speed = np.empty(n)
    left = np.empty(n)
    rate = np.empty(n)
    fade = np.exp(-dt / blend_time)
    farthest = 0.0

    for j in range(n):
        pull = (offset_rate[j] + offset[j] / blend_time) * dt
        rate[j] = fade * (offset_rate[j] - pull / blend_time)
        left[j] = fade * (offset[j] + pull)
        angle[j] = q[j] + left[j]
        speed[j] = qd[j] + rate[j]
        farthest = max(farthest, abs(angle[j] - q_last[j]))

    if farthest > most:
        for j in range(n):
            angle[j] = q_last[j] + (angle[j] - q_last[j]) * most / farthest

    return angle, speed, left, rate
