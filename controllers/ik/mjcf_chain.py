"""Fields of a serial chain between a body and a site of a compiled MuJoCo model."""

from collections.abc import Iterable, Sequence
from typing import Any

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, inverse, pose, readonly, shown

# kinds of joints that a chain may have, as `Chain.joint_types` names them
_STILL = 1e-9  # [m] of motion per joint value, below which a telescope does not move
_ROUNDED = 1e-9  # likewise, by which rounding may change the 1 of a joint without followers
_LETTERS = {int(mujoco.mjtJoint.mjJNT_HINGE): "r", int(mujoco.mjtJoint.mjJNT_SLIDE): "p"}


def chain_fields(
    model: mujoco.MjModel, base_body: str, tip_site: str, exclude: Sequence[str]
) -> dict[str, Any]:
    """Fields of the chain of `Chain.from_mjcf`; its limits are not checked yet.

    Raises:
        ConfigurationError: as `Chain.from_mjcf`.
    """
    base = _find(model, mujoco.mjtObj.mjOBJ_BODY, base_body, "base_body")
    site = _find(model, mujoco.mjtObj.mjOBJ_SITE, tip_site, "tip_site")
    if isinstance(exclude, str) or not isinstance(exclude, Iterable):
        raise ConfigurationError(f"exclude: expected names of joints, got {shown(exclude)}")
    excluded = {_find(model, mujoco.mjtObj.mjOBJ_JOINT, name, "exclude") for name in exclude}

    joints = _joints_between(model, base, site, excluded)
    names = [model.joint(j).name for j in joints]

    # Axes at joint values of zero, followers where their equality puts them
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[model.jnt_qposadr[joints]] = 0.0
    followers = _followers(model, joints)
    for follower, (_, constant, _) in followers.items():
        data.qpos[model.jnt_qposadr[follower]] = constant
    mujoco.mj_kinematics(model, data)

    limits = np.where(
        model.jnt_limited[joints].astype(bool)[:, None], model.jnt_range[joints], [-np.inf, np.inf]
    )

    # A hinge and its follower are one pantograph link, a slide and its followers one telescope.
    links = np.zeros((len(joints), 3))
    types = [_LETTERS[int(model.jnt_type[j])] for j in joints]
    moves = np.array(data.xaxis[joints])  # of what each joint carries, per joint value
    for follower, (leader, constant, ratio) in followers.items():
        i = joints.index(leader)
        k = joints.index(follower)
        if types[i] == "p":
            moves[i] += ratio * data.xaxis[follower]
        else:
            if np.abs(data.xaxis[leader] + ratio * data.xaxis[follower]).max() > 1e-6:
                raise ConfigurationError(
                    f"joints {names[i]!r} and {names[k]!r} are coupled, but do not keep what they "
                    "carry parallel"
                )
            types[i] = "o"
            links[i] = data.xanchor[follower] - data.xanchor[leader]
        limits[i] = _shared(limits[i], limits[k], constant, ratio)

    travels = np.linalg.norm(moves, axis=1)
    if not travels.min() > _STILL:
        name = names[int(np.argmin(travels))]
        raise ConfigurationError(f"joint {name!r}: its followers cancel its motion")
    # exact where nothing follows
    travels = np.where(np.abs(travels - 1.0) < _ROUNDED, 1.0, travels)

    # What is left, in the frame of the base
    independent = [i for i, j in enumerate(joints) if j not in followers]
    ids = [joints[i] for i in independent]
    X_W_base = pose(data.xmat[base].reshape(3, 3), data.xpos[base])
    X_W_tip = pose(data.site_xmat[site].reshape(3, 3), data.site_xpos[site])
    R_W_base = X_W_base[:3, :3]
    return {
        "joint_types": "".join(types[i] for i in independent),
        "axes": readonly((moves / travels[:, None])[independent] @ R_W_base),
        "travels": readonly(travels[independent]),
        "points": readonly((data.xanchor[ids] - X_W_base[:3, 3]) @ R_W_base),
        "links": readonly(links[independent] @ R_W_base),
        "X_base_tip0": readonly(inverse(X_W_base) @ X_W_tip),
        "limits": limits[independent],
        "names": tuple(names[i] for i in independent),
    }


def _joints_between(model: mujoco.MjModel, base: int, site: int, excluded: set[int]) -> list[int]:
    """Hinges and slides between a body and a site, base to tip; ConfigurationError for others."""
    bodies = []
    body = int(model.site_bodyid[site])
    while body not in (base, 0):
        bodies.append(body)
        body = int(model.body_parentid[body])

    base_body = model.body(base).name
    tip_site = model.site(site).name
    if body != base:
        raise ConfigurationError(
            f"tip_site: {tip_site!r} must be carried by body {base_body!r} or a body beyond it"
        )

    joints = [
        j
        for body in reversed(bodies)
        for j in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body])
        if j not in excluded
    ]
    for j in joints:
        if int(model.jnt_type[j]) not in _LETTERS:
            raise ConfigurationError(
                f"joint {model.joint(j).name!r}: only hinges and slides can be solved for, not "
                "ball or free"
            )
    if not joints:
        raise ConfigurationError(f"no joint between body {base_body!r} and site {tip_site!r}")
    return joints


def _followers(model: mujoco.MjModel, joints: list[int]) -> dict[int, tuple[int, float, float]]:
    """Joints coupled to one before: {follower: (leader, c, r)}, q = c + r q_leader."""
    followers: dict[int, tuple[int, float, float]] = {}
    for e in range(model.neq):
        pair = [int(model.eq_obj1id[e]), int(model.eq_obj2id[e])]
        coupled = model.eq_type[e] == mujoco.mjtEq.mjEQ_JOINT and model.eq_active0[e]
        if not coupled or not set(pair) <= set(joints):
            continue

        # MuJoCo: q1 - q1_0 = c0 + c1 (q2 - q2_0) + ..., where q_0 is the joint's value at qpos0.
        c0, c1 = model.eq_data[e, :2]
        first, second = sorted(pair, key=joints.index)
        between = joints[joints.index(first) : joints.index(second) + 1]
        linear = c1 != 0.0 and not np.any(model.eq_data[e, 2:5])
        slides = all(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE for j in between)
        hinges = all(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE for j in pair)
        parallel = hinges and len(between) == 2 and abs(c1) == 1.0

        if not linear or not (slides or parallel) or second in followers:
            raise ConfigurationError(
                f"joints {model.joint(first).name!r} and {model.joint(second).name!r}: the only "
                "couplings known are a pantograph link (two hinges in a row, polycoef c 1 or c "
                "-1) and a telescope (slides with only slides between them, polycoef c r), got "
                f"{model.eq_data[e, :5].tolist()}"
            )

        # The value of the second joint at a leader at zero, whichever the equality names first
        at_rest = {j: float(model.qpos0[model.jnt_qposadr[j]]) for j in pair}
        ratio = float(c1) if pair[0] == second else 1.0 / float(c1)
        shift = float(c0) if pair[0] == second else -float(c0) * ratio
        followers[second] = (first, at_rest[second] + shift - ratio * at_rest[first], ratio)

    # Three hinges that are coupled in a row are no pantograph link.
    for follower, (leader, _, _) in followers.items():
        if leader in followers and model.jnt_type[leader] == mujoco.mjtJoint.mjJNT_HINGE:
            raise ConfigurationError(
                f"joint {model.joint(leader).name!r}: must not both follow a hinge and lead joint "
                f"{model.joint(follower).name!r}"
            )
    return {follower: _resolved(followers, follower) for follower in followers}


def _resolved(
    followers: dict[int, tuple[int, float, float]], follower: int
) -> tuple[int, float, float]:
    """Leader that follows no other joint, constant and ratio of a follower."""
    leader, constant, ratio = followers[follower]
    while leader in followers:  # always a joint before it
        leader, more, factor = followers[leader]
        constant += ratio * more
        ratio *= factor
    return leader, constant, ratio


def _shared(
    limits: Array, of_follower: Array, constant: float, ratio: float
) -> tuple[float, float]:
    """Limits of a leader within which its follower keeps its own."""
    low, high = np.sort((of_follower - constant) / ratio)
    return max(float(limits[0]), float(low)), min(float(limits[1]), float(high))


def _find(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str, argument: str) -> int:
    """Index of a named element of a model; ConfigurationError with the known names if unknown."""
    if not isinstance(model, mujoco.MjModel):
        raise ConfigurationError(f"model: expected a mujoco.MjModel, got {shown(model)}")
    if not isinstance(name, str) or not name.isprintable():  # None would crash MuJoCo
        raise ConfigurationError(f"{argument}: expected a name, got {shown(name)}")

    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        count = {
            mujoco.mjtObj.mjOBJ_BODY: model.nbody,
            mujoco.mjtObj.mjOBJ_SITE: model.nsite,
            mujoco.mjtObj.mjOBJ_JOINT: model.njnt,
        }[kind]
        known = [mujoco.mj_id2name(model, kind, i) or "" for i in range(count)]
        raise ConfigurationError(
            f"{argument}: the model has {', '.join(filter(None, known))}, got {shown(name)}"
        )
    return index
