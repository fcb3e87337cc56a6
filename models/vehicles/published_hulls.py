"""Hulls from published tables, and the conversion of their axes to those of this project.

Marine literature uses body axes forward, starboard, down [SNAME 1950], [Fossen 2011, section 2.1].
The axes of this project are forward, port, up, which differ by a half turn about x. `from_ned`
converts by this turn. The table of a source is entered as printed in a `PublishedHull`, and
`add_hull` converts it once.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models import hydrodynamics
from uuv.models.hydrodynamics import SEA_WATER, BodyHydrodynamics
from uuv.models.naming import CAMERA_SITE, HOME_KEY, HULL_BODY, READY_KEY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, rotation_from_z, skew

TIMESTEP = 0.002  # [s] time step of the simulation
_HALF_TURN = np.diag([1.0, -1.0, -1.0])  # rotation about x


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PublishedHull:
    """Parameters of one hull, in the source's axes (forward, starboard, down) and origin."""

    mass: float  # [kg] dry
    center_of_gravity: ArrayLike  # (3,) [m]
    inertia: ArrayLike  # (3, 3) [kg m^2] about the origin, products with the signs of the matrix
    volume: float  # [m^3]
    center_of_buoyancy: ArrayLike  # (3,) [m]
    added_mass: ArrayLike  # (6, 6) [kg, kg m, kg m^2], -X_udot and so on
    linear_damping: ArrayLike  # (6,), all >= 0 [N s/m, N m s]
    quadratic_damping: ArrayLike  # (6,), all >= 0 [N s^2/m^2, N m s^2]


def from_ned(values: ArrayLike) -> Array:
    """Convert (3,), (6,), (3, 3) or (6, 6) from forward-starboard-down to forward-port-up axes.

    A half turn is its own inverse, so the same function converts back. Moments of inertia, added
    masses and damping turn as matrices: the couplings x-y and x-z change sign, y-z does not. The
    diagonal is unchanged, so that a diagonal quadratic damping is unchanged too.

    Raises:
        ConfigurationError: another shape.
    """
    array = np.asarray(values, dtype=np.float64)
    if array.shape not in ((3,), (6,), (3, 3), (6, 6)):
        raise ConfigurationError(
            f"from_ned: expected a vector or a square matrix of 3 or 6, got shape {array.shape}"
        )
    turn = np.kron(np.eye(len(array) // 3), _HALF_TURN)
    return turn @ array if array.ndim == 1 else turn @ array @ turn.T


def new_spec(name: str) -> mujoco.MjSpec:
    """Empty spec with the options that all vehicles of this project have."""
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    return spec


def add_hull(spec: mujoco.MjSpec, hull: PublishedHull) -> mujoco.MjsBody:
    """Add the free body "hull" with the figures of `hull`; the origin is that of the source."""
    body = spec.worldbody.add_body(name=HULL_BODY)
    body.add_freejoint(name=HULL_BODY)

    # Inertia about the centre of mass, by the parallel axis theorem.
    center = from_ned(hull.center_of_gravity)
    S = skew(center)
    set_inertial(body, hull.mass, center, from_ned(hull.inertia) + hull.mass * S @ S)

    coefficients = BodyHydrodynamics(
        volume=hull.volume,
        center_of_buoyancy=from_ned(hull.center_of_buoyancy),
        added_mass=from_ned(hull.added_mass),
        linear_damping=from_ned(np.diag(np.asarray(hull.linear_damping, dtype=np.float64))),
        quadratic_damping=np.asarray(hull.quadratic_damping, dtype=np.float64),
    )
    hydrodynamics.attach(spec, {HULL_BODY: coefficients})
    return body


def set_inertial(body: mujoco.MjsBody, mass: float, center: ArrayLike, inertia: ArrayLike) -> None:
    """Set mass and inertia of `body`, in body axes.

    Args:
        body: changed in place.
        mass: [kg].
        center: (3,) [m] centre of mass.
        inertia: (3, 3) [kg m^2] about the centre of mass.
    """
    about = np.asarray(inertia, dtype=np.float64)
    body.explicitinertial = True
    body.mass = mass
    body.ipos = center

    body.fullinertia = [
        about[0, 0],
        about[1, 1],
        about[2, 2],
        about[0, 1],
        about[0, 2],
        about[1, 2],
    ]


def add_capsule(
    body: mujoco.MjsBody,
    name: str,
    radius: float,
    ends: tuple[ArrayLike, ArrayLike],
    rgba: ArrayLike,
) -> None:
    """Add the massless shape of a slender part; it collides with the world, not with other parts of
    the vehicle.

    Args:
        body: body to which the shape is added.
        name: name of the geom.
        radius: [m].
        ends: (3,) [m] positions of both ends in body axes.
        rgba: (4,) colour.
    """
    body.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[radius, 0.0, 0.0],
        fromto=[*np.asarray(ends[0]), *np.asarray(ends[1])],
        mass=0.0,
        contype=1,
        conaffinity=2,
        rgba=rgba,
    )


def add_thruster(
    spec: mujoco.MjSpec, hull: mujoco.MjsBody, name: str, p: ArrayLike, direction: ArrayLike
) -> str:
    """Add the site and the actuator [N] of a thruster.

    Args:
        spec: model.
        hull: body on which the thruster acts.
        name: suffix of the actuator's name.
        p: (3,) [m] position in hull axes.
        direction: (3,) of positive thrust in hull axes.

    Returns:
        The actuator's name, for `uuv.models.water.thrusters.attach`.
    """
    axis = np.asarray(direction, dtype=np.float64)
    # x along the thrust
    R = rotation_from_z(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])[:, [2, 0, 1]]

    full_name = f"thruster_{name}"
    hull.add_site(
        name=full_name, pos=p, quat=quat_wxyz_from_rotation(R), group=4, size=[0.01, 0.01, 0.01]
    )
    actuator = spec.add_actuator(name=full_name, trntype=mujoco.mjtTrn.mjTRN_SITE, target=full_name)
    actuator.gear = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    return full_name


def add_camera(hull: mujoco.MjsBody, p: ArrayLike, down: float) -> None:
    """Add the camera at `p` (3,) [m], looking ahead and `down` [rad] from the level."""
    s = np.sin(down)
    c = np.cos(down)
    R_BC = np.array([[0.0, -s, c], [-1.0, 0.0, 0.0], [0.0, -c, -s]])
    hull.add_site(
        name=CAMERA_SITE, pos=p, quat=quat_wxyz_from_rotation(R_BC), group=4, size=[0.01] * 3
    )


def add_wrench(spec: mujoco.MjSpec, hull: mujoco.MjsBody) -> None:
    """Add six actuators `wrench_surge` to `wrench_yaw`: the wrench on the hull, hull axes [N, N m].

    It acts at the hull's origin, for vehicles whose source has no thrusters.
    """
    hull.add_site(name="wrench", group=4, size=[0.01, 0.01, 0.01])
    for axis, name in enumerate(("surge", "sway", "heave", "roll", "pitch", "yaw")):
        actuator = spec.add_actuator(
            name=f"wrench_{name}", trntype=mujoco.mjtTrn.mjTRN_SITE, target="wrench"
        )
        actuator.gear = np.eye(6)[axis]


def add_keys(spec: mujoco.MjSpec, home: ArrayLike = (), ready: ArrayLike | None = None) -> None:
    """Add the keyframes `home` and `ready`: vehicle at the origin, arm at the given joint angles.

    Args:
        spec: model.
        home: (n,) [rad] folded posture.
        ready: (n,) [rad] working posture; by default `home`.
    """
    rest = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    spec.add_key(name=HOME_KEY, qpos=[*rest, *np.asarray(home, dtype=np.float64)])
    spec.add_key(
        name=READY_KEY,
        qpos=[*rest, *np.asarray(home if ready is None else ready, dtype=np.float64)],
    )


def ballast(spec: mujoco.MjSpec, water_density: float = SEA_WATER) -> BodyHydrodynamics:
    """Trim the vehicle in the posture `home`, keeping the height of the hull's centre of buoyancy
    of the source.

    The hull's volume changes until the whole vehicle is neutrally buoyant in water of
    `water_density` [kg/m^3]. Its centre of buoyancy shifts fore and aft, as with foam on a real
    hull. Returns the hull's coefficients.
    """
    hydrodynamics.attach(spec, {}, water_density)
    home = next(key for key in spec.keys if key.name == HOME_KEY).qpos
    height = float(hydrodynamics.attached(spec)[HULL_BODY].center_of_buoyancy[2])
    flat = hydrodynamics.trim(spec, HULL_BODY, metacentric_height=0.0, qpos=home)

    # At neutral buoyancy volumes are proportional to buoyancy forces, so the height of the hull's
    # centre of buoyancy is weighted by the hull's share of the volume.
    share = flat.volume / sum(body.volume for body in hydrodynamics.attached(spec).values())
    metacentric_height = share * (height - float(flat.center_of_buoyancy[2]))
    return hydrodynamics.trim(spec, HULL_BODY, metacentric_height=metacentric_height, qpos=home)
