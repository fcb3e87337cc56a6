"""Bodies of a vehicle's arm as arrays, read from a compiled model."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3

FIXED, HINGE, SLIDE = 0, 1, 2  # joint kinds
OF_BODIES = {
    "axis": 3,
    "R0": 9,
    "p0": 3,
    "mass": 1,
    "com": 3,
    "inertia": 9,
    "added": 36,
    "linear": 36,
    "quadratic": 6,
    "buoyancy": 1,
    "cob": 3,
    "origin": 3,
}  # number of each parameter per body, in the order of the packed block that the kernels read


@dataclass(frozen=True, slots=True, eq=False)
class ArmTree:
    """Bodies of the arm, parents first; row i of every array is body i."""

    parent: np.ndarray  # (nb,) row of the parent body, -1 for the hull
    kind: np.ndarray  # (nb,) FIXED, HINGE or SLIDE
    column: np.ndarray  # (nb,) index of the joint in q, or -1
    axis: Array  # (nb, 3) joint axis in body axes
    # (nb, 3, 3) body in parent at q = 0; joints that are not coordinates stay at their qpos0
    R0: Array
    p0: Array  # (nb, 3) joint frame in the parent's joint frame, at q = 0 [m]
    mass: Array  # (nb,) [kg]
    com: Array  # (nb, 3) centre of mass [m]
    inertia: Array  # (nb, 3, 3) inertia about the joint frame's origin [kg m^2]
    added: Array  # (nb, 6, 6)
    linear: Array  # (nb, 6, 6)
    quadratic: Array  # (nb, 6)
    buoyancy: Array  # (nb,) displaced mass rho V [kg]
    cob: Array  # (nb, 3) centre of buoyancy [m]
    # (nb, 3) the body's own origin in its joint frame [m]; the coefficients refer to it
    origin: Array
    # (ns, 9): row of the body, position (3), unit axis (3), normal and tangential drag [N/(m/s)^2]
    stations: Array

    def packed(self, gravity: Array, R_tip: Array, p_tip: Array) -> Array:
        """Pack all parameters into one block: those of the bodies, gravity, tip position and
        rotation.
        """
        blocks = [*(getattr(self, name) for name in OF_BODIES), gravity, p_tip, R_tip]
        return np.concatenate([np.ravel(block) for block in blocks])


def read_tree(
    model: mujoco.MjModel, vehicle: Vehicle, passive: bool, water_scale: float
) -> tuple[ArmTree, tuple[str, ...], dict[int, int]]:
    """Tree of the bodies carried by the hull, names of the joints that are coordinates, and the row
    of each body.

    Args:
        model: compiled model of the vehicle.
        vehicle: the vehicle in it.
        passive: True: joints without actuator are coordinates too.
        water_scale: [-] factor of all hydrodynamic coefficients.

    Raises:
        ConfigurationError: a joint is neither a hinge nor a slide, or a body has several joints.
    """
    bodies = [b for b in range(vehicle.hull + 1, model.nbody) if _carried(model, b, vehicle.hull)]
    rows = {body: row for row, body in enumerate(bodies)}
    tree = _empty_tree(len(bodies), _stations(model, rows, water_scale))

    names: list[str] = []
    driven = set(vehicle.joints.tolist())
    for body, row in rows.items():
        joint = _joint_of(model, body)
        anchor = np.zeros(3) if joint is None else np.array(model.jnt_pos[joint])
        if joint is not None and (joint in driven or passive):
            hinge = int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_HINGE
            tree.kind[row] = HINGE if hinge else SLIDE
            tree.column[row] = len(names)
            tree.axis[row] = model.jnt_axis[joint]
            names.append(model.joint(joint).name)

        parent = rows.get(int(model.body_parentid[body]))
        _set_pose(tree, row, model, body, anchor, parent)
        _set_inertia(tree, row, model, body, anchor)
        _set_water(tree, row, model, body, water_scale)

    return tree, tuple(names), rows


def _empty_tree(nb: int, stations: Array) -> ArmTree:
    """Tree of `nb` bodies on the hull, all numbers zero, with its drag stations (ns, 9)."""
    return ArmTree(
        parent=np.full(nb, -1, dtype=np.int64),
        kind=np.zeros(nb, dtype=np.int64),
        column=np.full(nb, -1, dtype=np.int64),
        axis=np.zeros((nb, 3)),
        R0=np.zeros((nb, 3, 3)),
        p0=np.zeros((nb, 3)),
        mass=np.zeros(nb),
        com=np.zeros((nb, 3)),
        inertia=np.zeros((nb, 3, 3)),
        added=np.zeros((nb, 6, 6)),
        linear=np.zeros((nb, 6, 6)),
        quadratic=np.zeros((nb, 6)),
        buoyancy=np.zeros(nb),
        cob=np.zeros((nb, 3)),
        origin=np.zeros((nb, 3)),
        stations=stations,
    )


def _joint_of(model: mujoco.MjModel, body: int) -> int | None:
    """The hinge or slide of a body, None for a fixed body; ConfigurationError for other joints."""
    if model.body_jntnum[body] > 1:
        raise ConfigurationError(
            f"body {model.body(body).name!r} of the arm has more than one joint"
        )
    if not model.body_jntnum[body]:
        return None

    joint = int(model.body_jntadr[body])
    kind = int(model.jnt_type[joint])
    if kind not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise ConfigurationError(
            f"joint {model.joint(joint).name!r} of the arm must be a hinge or a slide"
        )
    return joint


def _set_pose(
    tree: ArmTree, row: int, model: mujoco.MjModel, body: int, anchor: Array, parent: int | None
) -> None:
    """Write the joint frame of a body in that of its parent (a row; None: the hull), at q = 0."""
    # The joint frame lies at the joint's anchor, parallel to the body's axes.
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.body_quat[body])
    tree.origin[row] = -anchor
    tree.R0[row] = R.reshape(3, 3)
    tree.p0[row] = model.body_pos[body] + tree.R0[row] @ anchor
    if parent is not None:
        tree.parent[row] = parent
        tree.p0[row] += tree.origin[parent]

    if tree.column[row] >= 0:  # MuJoCo states the pose of a body at qpos0 (`ref`)
        at_rest = model.qpos0[model.jnt_qposadr[model.body_jntadr[body]]] * tree.axis[row]
        if tree.kind[row] == HINGE:
            tree.R0[row] = tree.R0[row] @ exp_so3(-at_rest)
        else:
            tree.p0[row] -= tree.R0[row] @ at_rest


def _set_inertia(tree: ArmTree, row: int, model: mujoco.MjModel, body: int, anchor: Array) -> None:
    """Mass, centre of mass, and inertia about the origin of the joint frame."""
    com = model.body_ipos[body] - anchor
    tree.mass[row] = model.body_mass[body]
    tree.com[row] = com

    R = np.empty(9)
    mujoco.mju_quat2Mat(R, model.body_iquat[body])
    principal = R.reshape(3, 3)
    tree.inertia[row] = principal @ np.diag(
        model.body_inertia[body]
    ) @ principal.T + model.body_mass[body] * (com @ com * np.eye(3) - np.outer(com, com))


def _set_water(
    tree: ArmTree, row: int, model: mujoco.MjModel, body: int, water_scale: float
) -> None:
    """Write the hydrodynamic coefficients of a body, times `water_scale`, and its buoyancy."""
    if not hydrodynamics.carries(model.body_user[body]):
        return

    water = hydrodynamics.without_forms(model.body_user[body], "the controller's model of the arm")
    tree.added[row] = water_scale * water.added_mass
    tree.linear[row] = water_scale * water.linear_damping
    tree.quadratic[row] = water_scale * water.quadratic_damping
    tree.buoyancy[row] = hydrodynamics.water_density(model) * water.volume
    tree.cob[row] = water.center_of_buoyancy


def _carried(model: mujoco.MjModel, body: int, hull: int) -> bool:
    """True if `hull` is an ancestor of `body`."""
    while body > hull:
        body = int(model.body_parentid[body])
    return body == hull


def _stations(model: mujoco.MjModel, rows: dict[int, int], water_scale: float) -> Array:
    """Gauss-Legendre stations (ns, 9) of all drag strips, as in `ArmParameters`."""
    stations: list[list[float]] = []
    for body, row in rows.items():
        if not hydrodynamics.carries(model.body_user[body]):
            continue

        for strip in hydrodynamics.unpack(model.body_user[body]).segments:
            along = strip.end - strip.start
            length = float(np.linalg.norm(along))
            for node, weight in zip(*np.polynomial.legendre.leggauss(strip.stations), strict=True):
                share = water_scale * 0.5 * weight * length
                position = strip.start + 0.5 * (1.0 + node) * along
                stations.append(
                    [
                        row,
                        *position,
                        *(along / length),
                        share * strip.normal,
                        share * strip.tangential,
                    ]
                )

    return np.array(stations).reshape(-1, 9)
