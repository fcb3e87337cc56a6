"""Denavit-Hartenberg rows of an arm in an MJCF: reading them, adding manufacturing errors, writing
them back.

Rows are those of `uuv.models.arms.serial_arm`: standard rows, and Hayati's rows where the next axis
is nearly parallel. In Hayati's rows d is 0 and beta tilts the axis [Hayati 1985]. The last frame is
that of the last joint (a zero row), and the tip site is fixed in that frame. Frame 0 has its origin
on the first axis.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from uuv.models.arms.kinematics import BETA, ROW, THETA, A, D
from uuv.models.arms.serial_arm import NEAR_PARALLEL, SerialArm, tilt_of
from uuv.models.naming import find
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    inverse,
    pose,
    quat_wxyz_from_rotation,
    readonly,
)

_INTERSECTING = 1e-9  # [m] if the common normal is shorter, the two axes are taken to intersect


def read(
    model: mujoco.MjModel, base_body: str, tip_site: str, exclude: Sequence[str] = ()
) -> SerialArm:
    """Read the arm between a body and a site of a compiled model. All its joints are hinges.

    Frame i has its origin where the common normal of axes i and i + 1 meets axis i + 1, and its x
    along that normal. If the two axes intersect, x is perpendicular to both; if they are parallel,
    d is 0. theta0 is the angle at which MuJoCo's joint value is zero.

    Args:
        model: compiled model.
        base_body: name of the body whose frame is the base.
        tip_site: name of the site that is the flange.
        exclude: names of joints (springs) that stay at their `qpos0` and are no joints of the arm.

    Returns:
        The arm, with the limits and names of the joints.

    Raises:
        ConfigurationError: a name is unknown, the site is not beyond the body, a joint is no hinge,
            there is no joint, or a link is longer than 50 m.
    """
    base = find(model, mujoco.mjtObj.mjOBJ_BODY, base_body)
    site = find(model, mujoco.mjtObj.mjOBJ_SITE, tip_site)
    joints = _hinges(model, base, site, exclude)

    # Excluded joints stay at rest, at their zero.
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)

    # Axes, a point on each, and the flange, in the base A.
    X_AW = inverse(pose(data.xmat[base].reshape(3, 3), data.xpos[base]))
    axes = data.xaxis[joints] @ X_AW[:3, :3].T
    points = data.xanchor[joints] @ X_AW[:3, :3].T + X_AW[:3, 3]
    X_AG = X_AW @ pose(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])

    # Along the chain, each row leads from the frame of one joint to that of the next.
    X = X_A0 = _first_frame(axes[0], points[0])
    table = np.zeros((len(joints), ROW))
    for k, (axis, point) in enumerate(zip(axes[1:], points[1:], strict=True)):
        table[k] = _row(X, axis, point)
        X = X @ _step(table[k])

    arm = SerialArm.from_dh(
        table[:, :BETA],
        beta=table[:, BETA],
        name=f"arm between body {base_body!r} and site {tip_site!r}",
    )

    limited = model.jnt_limited[joints].astype(bool)[:, None]
    return replace(
        arm,
        X_base_0=readonly(X_A0),
        X_n_flange=readonly(inverse(X) @ X_AG),
        limits=readonly(np.where(limited, model.jnt_range[joints], [-np.inf, np.inf])),
        joint_names=tuple(model.joint(j).name for j in joints),
    )


def move(spec: mujoco.MjSpec, old: SerialArm, new: SerialArm, base_body: str) -> None:
    """Move the links of a spec so that its arm becomes another; joint zeros and local axes stay.

    Each link is moved with the axis of its own joint, and inertia, shapes and hydrodynamics with
    the link. Bodies and sites that the last link carries are moved by the change of the tip in
    frame n.

    Args:
        spec: vehicle or arm, changed in place.
        old: its present arm, as `read` returns it.
        new: the arm after the move.
        base_body: name of the body whose frame is the base of both.

    Raises:
        ConfigurationError: the two arms have different joints, or two joints share a body.
    """
    if old.joint_names != new.joint_names:
        raise ConfigurationError(
            f"an arm of joints {old.joint_names} cannot be moved to one of {new.joint_names}"
        )

    model = spec.compile()
    joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in old.joint_names]
    links = [int(model.jnt_bodyid[j]) for j in joints]
    if len(set(links)) < len(links):
        raise ConfigurationError(
            f"an arm can be moved only if each of its joints {old.joint_names} has a body of its "
            "own"
        )

    data = mujoco.MjData(model)
    # at `qpos0`, the posture that pos and quat of the bodies describe
    mujoco.mj_kinematics(model, data)
    rest = model.qpos0[model.jnt_qposadr[joints]]
    X_AW = inverse(_world(data, find(model, mujoco.mjtObj.mjOBJ_BODY, base_body)))

    # Displacement of everything that link i carries, in base axes; the base stays.
    carried = [
        np.eye(4),
        *(b @ inverse(a) for a, b in zip(_links(old, rest), _links(new, rest), strict=True)),
    ]

    # Each link follows the axis of its own joint.
    bodies = {body.id: body for body in spec.bodies}
    for i, link in enumerate(links):
        X_AP = X_AW @ _world(data, int(model.body_parentid[link]))
        X_AL = X_AW @ _world(data, link)
        _set_pose(bodies[link], inverse(carried[i] @ X_AP) @ carried[i + 1] @ X_AL)

    # What the last link carries follows the tip.
    tip = _tip(new, rest) @ inverse(_tip(old, rest))
    X_AL = X_AW @ _world(data, links[-1])
    X_LA = inverse(carried[-1] @ X_AL)
    last = bodies[links[-1]]
    for child in last.bodies:
        _set_pose(child, X_LA @ tip @ X_AW @ _world(data, child.id))
    for site in last.sites:
        X_WS = pose(data.site_xmat[site.id].reshape(3, 3), data.site_xpos[site.id])
        _set_pose(site, X_LA @ tip @ X_AW @ X_WS)


def with_errors(
    arm: SerialArm,
    rng: np.random.Generator,
    *,
    length: float = 2e-3,
    angle: float = np.deg2rad(0.3),
) -> SerialArm:
    """Draw an arm as manufactured, with a normally distributed error of every number of every
    joint.

    Numbers that touches with the tip cannot observe are kept: the position of the arm along the
    first axis and its angle about that axis, and the row of the last joint, since the tip itself is
    drawn. In rows whose next axis is nearly parallel, beta has an error and d has none.

    Args:
        arm: nominal arm, as `read` returns it.
        rng: source of randomness.
        length: [m] standard deviation of d, of a, and of each coordinate of the tip.
        angle: [rad] standard deviation of theta0, alpha and beta.

    Returns:
        The arm with errors.
    """
    dh = arm.table[:, :BETA].copy()
    beta = arm.table[:, BETA].copy()

    parallel = np.isin(np.arange(arm.n), arm.near_parallel)

    # Standard deviations are zero for numbers that touches cannot observe, and for d where beta
    # replaces it.
    scale = np.tile([angle, length, length, angle], (arm.n, 1))
    scale[0, :2] = 0.0
    scale[-1] = 0.0
    scale[parallel, D] = 0.0

    dh += scale * rng.standard_normal((arm.n, BETA))
    beta += np.where(parallel, angle, 0.0) * rng.standard_normal(arm.n)

    X_n_flange = arm.X_n_flange.copy()
    X_n_flange[:3, 3] += length * rng.standard_normal(3)
    return replace(arm.with_table(np.column_stack([dh, beta])), X_n_flange=readonly(X_n_flange))


def _hinges(model: mujoco.MjModel, base: int, site: int, exclude: Sequence[str]) -> list[int]:
    excluded = {find(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in exclude}

    joints: list[int] = []
    body = int(model.site_bodyid[site])
    while body not in (base, 0):
        first = int(model.body_jntadr[body])
        count = int(model.body_jntnum[body])
        joints[:0] = [j for j in range(first, first + count) if j not in excluded]
        body = int(model.body_parentid[body])

    if body != base:
        raise ConfigurationError(
            f"site {model.site(site).name!r} is not carried by body {model.body(base).name!r}; the "
            "arm must lead from the body to the site"
        )
    if not joints:
        raise ConfigurationError(
            f"there is no joint between body {model.body(base).name!r} and site "
            f"{model.site(site).name!r}; an arm needs at least one hinge"
        )
    for j in joints:
        if int(model.jnt_type[j]) != mujoco.mjtJoint.mjJNT_HINGE:
            raise ConfigurationError(
                f"joint {model.joint(j).name!r}: must be a hinge, as DH rows are read from hinges "
                "only"
            )
    return joints


def _first_frame(axis: Array, point: Array) -> Array:
    """Frame 0 (4, 4) in A: z along the first axis, origin at the point of the axis nearest to A's,
    x near A's x.
    """
    origin = point - (point @ axis) * axis
    hint = np.eye(3)[0] if abs(axis[0]) < 0.9 else np.eye(3)[1]
    x = hint - (hint @ axis) * axis
    x /= np.linalg.norm(x)
    return pose(np.column_stack([x, np.cross(axis, x), axis]), origin)


def _row(X: Array, axis_A: Array, point_A: Array) -> Array:
    """Table row (5,) that leads from frame `X` (4, 4) to the axis `axis_A` through `point_A`."""
    z = X[:3, :3].T @ axis_A
    p = X[:3, :3].T @ (point_A - X[:3, 3])
    across = float(np.hypot(z[0], z[1]))
    if across < np.sin(NEAR_PARALLEL):
        # Hayati: the origin is where the line meets the plane of x and y.
        foot = p - p[2] / z[2] * z
        a = float(np.hypot(foot[0], foot[1]))
        theta = float(np.arctan2(foot[1], foot[0])) if a > _INTERSECTING else 0.0
        turned = exp_so3([0.0, 0.0, -theta]) @ z
        beta = float(np.arcsin(turned[0]))
        return np.array([theta, 0.0, a, float(np.arctan2(-turned[1], turned[2])), beta])

    # x along the common normal of the two axes, from this one to the next.
    along = -(p[0] * z[0] + p[1] * z[1]) / across**2
    foot = p + along * z
    normal = np.array([-z[1], z[0], 0.0]) / across
    a = float(foot @ normal)
    if a < -_INTERSECTING:
        normal = -normal
        a = -a

    theta = float(np.arctan2(normal[1], normal[0]))
    turned = exp_so3([0.0, 0.0, -theta]) @ z
    return np.array([theta, foot[2], max(a, 0.0), float(np.arctan2(-turned[1], turned[2])), 0.0])


def _step(row: Array, angle: float = 0.0) -> Array:
    """Frame i in frame i-1 (4, 4), for a table row (5,) of a hinge at a joint angle [rad]."""
    return pose(exp_so3([0.0, 0.0, row[THETA] + angle])) @ pose(tilt_of(row), [row[A], 0.0, row[D]])


def _frames(arm: SerialArm, q: Array) -> Array:
    """Frames 0 to n (n + 1, 4, 4) in the base at joint angles `q` (n,) [rad]."""
    X = arm.X_base_0
    out = [X]
    for row, angle in zip(arm.table, q, strict=True):
        X = X @ _step(row, angle)
        out.append(X)
    return np.array(out)


def _tip(arm: SerialArm, q: Array) -> Array:
    """Pose (4, 4) of the tip in the base at joint angles `q` (n,) [rad]."""
    return _frames(arm, q)[-1] @ arm.X_n_flange


def _links(arm: SerialArm, q: Array) -> Array:
    """Frames (n, 4, 4) in the base that are fixed to the links, with origins on the joints'
    axes.
    """
    shift = np.array(
        [
            pose(exp_so3([0.0, 0.0, row[THETA] + angle]), [0.0, 0.0, row[D]])
            for row, angle in zip(arm.table, q, strict=True)
        ]
    )
    return _frames(arm, q)[:-1] @ shift


def _world(data: mujoco.MjData, body: int) -> Array:
    return pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def _set_pose(element: mujoco.MjsBody | mujoco.MjsSite, X: Array) -> None:
    element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    element.pos = X[:3, 3]
    element.quat = quat_wxyz_from_rotation(X[:3, :3])
