"""The kinematics of an arm in an MJCF as Denavit-Hartenberg numbers, and an MJCF moved to other numbers.

Row i takes frame i-1, whose z is the axis of joint i, to frame i by

    Rz(theta0 + q) Tz(d) Tx(a) Rx(alpha) Ry(beta)

Standard DH (beta 0), and Hayati's form where the next axis is nearly parallel: then d is 0 and beta tilts the axis. The
last frame is that of the last joint (a zero row); from it the tip is a fixed pose. Frame 0 stands on the first axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.naming import find
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, checked, exp_so3, inverse, pose, quat_wxyz_from_rotation, readonly

NEAR_PARALLEL = np.deg2rad(5.0)  # [rad] between neighbouring axes, below which Hayati's form is used
_INTERSECTING = 1e-9  # [m] common normal, below which axes are taken to meet


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmGeometry:
    """A serial arm of hinges, described where MuJoCo's joint values are zero."""

    base_body: str  # A
    X_A0: Array  # (4, 4) frame 0 in the base body A
    dh: Array  # (n, 4) theta0 [rad], d [m], a [m], alpha [rad]; theta0 where MuJoCo's joint value is zero
    beta: Array  # (n,) [rad] Hayati's angle; 0 in standard rows
    X_nG: Array  # (4, 4) tip site in frame n
    limits: Array  # (n, 2) [rad]
    joint_names: tuple[str, ...]

    def frames(self, q: ArrayLike) -> Array:
        """Frames 0 to n (n + 1, 4, 4) in the base body, at joint angles `q` (n,) [rad]."""
        angles = checked(q, (len(self.dh),), "q")
        X = self.X_A0
        out = [X]
        for row, beta, angle in zip(self.dh, self.beta, angles, strict=True):
            X = X @ _step(row, beta, angle)
            out.append(X)
        return np.array(out)

    def tip(self, q: ArrayLike) -> Array:
        """Pose (4, 4) of the tip in the base body at joint angles `q` (n,) [rad]."""
        return self.frames(q)[-1] @ self.X_nG


def read(model: mujoco.MjModel, base_body: str, tip_site: str, exclude: Sequence[str] = ()) -> ArmGeometry:
    """The hinges between a body and a site of a compiled model; those in `exclude` (springs) stay out of it.

    Frame i stands where the common normal of axes i and i + 1 meets axis i + 1, x along it; meeting axes take x across
    both; parallel axes continue at d = 0. Raises ConfigurationError for unknown names, a site that is not beyond the
    body, joints that are no hinges, and a chain without joints.
    """
    base = find(model, mujoco.mjtObj.mjOBJ_BODY, base_body)
    site = find(model, mujoco.mjtObj.mjOBJ_SITE, tip_site)
    joints = _hinges(model, base, site, exclude)
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    X_AW = inverse(pose(data.xmat[base].reshape(3, 3), data.xpos[base]))
    axes = data.xaxis[joints] @ X_AW[:3, :3].T
    points = data.xanchor[joints] @ X_AW[:3, :3].T + X_AW[:3, 3]
    X_AG = X_AW @ pose(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])
    X = X_A0 = _first_frame(axes[0], points[0])
    rows, betas = [], []
    for axis, point in zip(axes[1:], points[1:], strict=True):
        row, beta = _row(X, axis, point)
        rows.append(row)
        betas.append(beta)
        X = X @ _step(row, beta)
    rows.append(np.zeros(4))
    betas.append(0.0)
    return ArmGeometry(
        base_body=base_body,
        X_A0=readonly(X_A0),
        dh=readonly(np.array(rows)),
        beta=readonly(np.array(betas)),
        X_nG=readonly(inverse(X) @ X_AG),
        limits=readonly(
            np.where(model.jnt_limited[joints].astype(bool)[:, None], model.jnt_range[joints], [-np.inf, np.inf])
        ),
        joint_names=tuple(model.joint(j).name for j in joints),
    )


def move(spec: mujoco.MjSpec, old: ArmGeometry, new: ArmGeometry) -> None:
    """Move the links of `spec`, whose arm is `old`, so that its arm is `new`; zeros and local axes of the joints stay.

    Each link rides with the axis of its own joint, its inertia, shapes and water with it; the bodies and sites that the
    last link carries are moved by the change of the tip in frame n. Raises ConfigurationError if the two arms have
    other joints, or if two joints share a body.
    """
    if old.joint_names != new.joint_names:
        raise ConfigurationError(f"an arm of joints {old.joint_names} cannot be moved to one of {new.joint_names}")
    model = spec.compile()
    joints = [find(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in old.joint_names]
    links = [int(model.jnt_bodyid[j]) for j in joints]
    if len(set(links)) < len(links):
        raise ConfigurationError(f"to move an arm, each of the joints {old.joint_names} needs a body of its own")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)  # at qpos0, where pos and quat of the bodies apply
    rest = model.qpos0[model.jnt_qposadr[joints]]
    X_AW = inverse(_world(data, find(model, mujoco.mjtObj.mjOBJ_BODY, old.base_body)))
    # Displacement of everything that link i carries, in base axes; the base stays.
    carried = [np.eye(4), *(b @ inverse(a) for a, b in zip(_links(old, rest), _links(new, rest), strict=True))]
    bodies = {body.id: body for body in spec.bodies}
    for i, link in enumerate(links):
        X_AP, X_AL = X_AW @ _world(data, int(model.body_parentid[link])), X_AW @ _world(data, link)
        _set_pose(bodies[link], inverse(carried[i] @ X_AP) @ carried[i + 1] @ X_AL)
    tip = new.tip(rest) @ inverse(old.tip(rest))
    X_AL = X_AW @ _world(data, links[-1])
    X_LA = inverse(carried[-1] @ X_AL)
    last = bodies[links[-1]]
    for child in last.bodies:
        _set_pose(child, X_LA @ tip @ X_AW @ _world(data, child.id))
    for site in last.sites:
        X_WS = pose(data.site_xmat[site.id].reshape(3, 3), data.site_xpos[site.id])
        _set_pose(site, X_LA @ tip @ X_AW @ X_WS)


def with_errors(
    geometry: ArmGeometry, rng: np.random.Generator, *, length: float = 2e-3, angle: float = np.deg2rad(0.3)
) -> ArmGeometry:
    """The arm as a workshop might have built it: every number of every joint off, normally distributed.

    `length` [m] and `angle` [rad] are the standard deviations. What nothing at the tip can tell stays: how the arm
    stands on its base along and about the first axis, and the zero of the last joint, which is the tool's affair; the
    tip is off by `length` along each axis. Hayati rows get beta instead of d.
    """
    dh, beta = geometry.dh.copy(), geometry.beta.copy()
    n = len(dh)
    parallel = _parallel(geometry)
    scale = np.tile([angle, length, length, angle], (n, 1))
    scale[0, :2] = 0.0
    scale[-1] = 0.0
    scale[parallel, 1] = 0.0
    dh += scale * rng.standard_normal((n, 4))
    beta += np.where(parallel, angle, 0.0) * rng.standard_normal(n)
    X_nG = geometry.X_nG.copy()
    X_nG[:3, 3] += length * rng.standard_normal(3)
    return replace(geometry, dh=readonly(dh), beta=readonly(beta), X_nG=readonly(X_nG))


def _parallel(geometry: ArmGeometry) -> np.ndarray:
    """(n,) bool: the row's axis and the next are nearly parallel. The last row has no next axis."""
    tilt = np.arccos(np.clip(np.abs(np.cos(geometry.dh[:, 3]) * np.cos(geometry.beta)), 0.0, 1.0))
    return (tilt < NEAR_PARALLEL) & (np.arange(len(tilt)) < len(tilt) - 1)


def _hinges(model: mujoco.MjModel, base: int, site: int, exclude: Sequence[str]) -> list[int]:
    excluded = {find(model, mujoco.mjtObj.mjOBJ_JOINT, name) for name in exclude}
    joints: list[int] = []
    body = int(model.site_bodyid[site])
    while body not in (base, 0):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints[:0] = [j for j in range(first, first + count) if j not in excluded]
        body = int(model.body_parentid[body])
    if body != base:
        raise ConfigurationError(
            f"site {model.site(site).name!r} must be carried beyond body {model.body(base).name!r}"
        )
    if not joints:
        raise ConfigurationError(f"no joint between body {model.body(base).name!r} and site {model.site(site).name!r}")
    for j in joints:
        if int(model.jnt_type[j]) != mujoco.mjtJoint.mjJNT_HINGE:
            raise ConfigurationError(f"joint {model.joint(j).name!r}: DH rows here are of hinges only")
    return joints


def _first_frame(axis: Array, point: Array) -> Array:
    """Frame 0 (4, 4) in A: z the first axis, origin where it is nearest to A's, x near A's x."""
    origin = point - (point @ axis) * axis
    hint = np.eye(3)[0] if abs(axis[0]) < 0.9 else np.eye(3)[1]
    x = hint - (hint @ axis) * axis
    x /= np.linalg.norm(x)
    return pose(np.column_stack([x, np.cross(axis, x), axis]), origin)


def _row(X: Array, axis_A: Array, point_A: Array) -> tuple[Array, float]:
    """DH row and beta that take frame `X` (4, 4) to one whose z is the line through `point_A` along `axis_A`."""
    z, p = X[:3, :3].T @ axis_A, X[:3, :3].T @ (point_A - X[:3, 3])
    across = float(np.hypot(z[0], z[1]))
    if across < np.sin(NEAR_PARALLEL):
        # Hayati: the origin is where the line meets the plane of x and y.
        foot = p - p[2] / z[2] * z
        a = float(np.hypot(foot[0], foot[1]))
        theta = float(np.arctan2(foot[1], foot[0])) if a > _INTERSECTING else 0.0
        turned = exp_so3([0.0, 0.0, -theta]) @ z
        beta = float(np.arcsin(turned[0]))
        return np.array([theta, 0.0, a, float(np.arctan2(-turned[1], turned[2]))]), beta
    # x along the common normal of the two lines, from this z to that one.
    along = -(p[0] * z[0] + p[1] * z[1]) / across**2
    foot = p + along * z
    normal = np.array([-z[1], z[0], 0.0]) / across
    a = float(foot @ normal)
    if a < -_INTERSECTING:
        normal, a = -normal, -a
    theta = float(np.arctan2(normal[1], normal[0]))
    turned = exp_so3([0.0, 0.0, -theta]) @ z
    return np.array([theta, foot[2], max(a, 0.0), float(np.arctan2(-turned[1], turned[2]))]), 0.0


def _step(row: Array, beta: float, angle: float = 0.0) -> Array:
    """Frame i in frame i-1 (4, 4), for a DH row with Hayati's beta at a joint angle [rad]."""
    theta0, d, a, alpha = row
    tilt = exp_so3([alpha, 0.0, 0.0]) @ exp_so3([0.0, beta, 0.0])
    return pose(exp_so3([0.0, 0.0, theta0 + angle])) @ pose(tilt, [a, 0.0, d])


def _links(geometry: ArmGeometry, q: Array) -> Array:
    """Frames (n, 4, 4) in the base body that ride with the links: each on its joint's axis, turned with it."""
    shift = np.array(
        [
            pose(exp_so3([0.0, 0.0, row[0] + angle]), [0.0, 0.0, row[1]])
            for row, angle in zip(geometry.dh, q, strict=True)
        ]
    )
    return geometry.frames(q)[:-1] @ shift


def _world(data: mujoco.MjData, body: int) -> Array:
    return pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def _set_pose(thing: mujoco.MjsBody | mujoco.MjsSite, X: Array) -> None:
    thing.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    thing.pos, thing.quat = X[:3, 3], quat_wxyz_from_rotation(X[:3, :3])
