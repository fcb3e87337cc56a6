"""Site of a panel whose plug is held in its receptacle by a seal with friction.

The seal of a receptacle is a ring of elastic beads that press on the pin by the depth d by which
they would reach into it. Each is a contact of the stiffness K with the friction mu, so that the
plug breaks away at

    F = n mu K d.

d is chosen by the wanted F. A nose that comes in spreads the beads. The same plug meets the same
seal in both receptacles.
"""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from uuv.models import hydrodynamics
from uuv.models.naming import RECEPTACLE
from uuv.models.objects.manifold import Hole
from uuv.models.site.plugged_panel import (
    COLLAR,
    DEBRIS,
    HANDLE,
    PIN,
    RECEPTACLES,
    PluggedPanel,
    Seat,
)
from uuv.models.site.scenes import seabed_height
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    inverse,
    quat_wxyz_from_rotation,
    transform_points,
)

if TYPE_CHECKING:
    import mujoco

BEADS = 6  # of a seal
BEAD = 0.008  # [m] radius of a bead
SEAL_DEPTH = 0.028  # [m] of the beads below the mouth
SEAL_STIFFNESS = 4e3  # [N/m] of a bead
SEAL_FRICTION = 0.9  # coefficient, rubber on a wet pin
FRICTION = (0.3, 0.005, 0.0001)  # of the plug on the panel: slides, turns, rolls
# soft, so that the pull of a sliding pin hardly changes how firmly the beads press
_SEAL_IMPEDANCE = 0.5
_SEAL_FRICTION_TIME = 0.3  # [s] time constant of the seal's friction
_INWARDS = np.array([0.0, 0.0, 1.0])  # of a receptacle's frame
_SOLREF = (0.006, 1.0)
_SOLIMP = (0.95, 0.99, 0.0005, 0.5, 2.0)


def plug_site(
    vehicle: "mujoco.MjSpec", panel: PluggedPanel, X_WT: Array, seat: Seat
) -> "mujoco.MjSpec":
    """Add a panel, its plug and flat seabed to the spec of a vehicle with a gripper.

    Args:
        vehicle: spec, changed in place.
        panel: shape of panel and plug.
        X_WT: (4, 4) pose of the panel.
        seat: friction.

    Returns:
        The same spec.
    """
    import mujoco

    from uuv.models.site.grip_contact import let_gripper_hold

    spec = vehicle
    _add_panel(spec, panel, X_WT, seat)
    weight = _add_plug(spec, panel, X_WT, seat)
    for name in RECEPTACLES:
        _add_seal(spec, name, seat, weight)

    seabed = spec.worldbody.add_geom()
    seabed.name = "seabed"
    seabed.type = mujoco.mjtGeom.mjGEOM_PLANE
    seabed.size = [8.0, 8.0, 0.1]
    seabed.pos = [X_WT[0, 3], X_WT[1, 3], seabed_height(panel.target, X_WT)]
    seabed.rgba = [0.55, 0.5, 0.4, 1.0]

    let_gripper_hold(spec, TARGET_BODY)
    return spec


def _add_panel(spec: "mujoco.MjSpec", panel: PluggedPanel, X_WT: Array, seat: Seat) -> None:
    """Add the panel; each receptacle is a body of its own, whose sensor measures the force on it.

    A receptacle's frame is that of its mouth, z inwards.
    """
    import mujoco

    place = {"pos": X_WT[:3, 3], "quat": quat_wxyz_from_rotation(X_WT[:3, :3])}
    block = spec.worldbody.add_body(name="panel", **place)
    bodies = {}
    for name in RECEPTACLES:
        X_WH = panel.hole(name).pose(X_WT)
        bodies[name] = spec.worldbody.add_body(
            name=RECEPTACLE + name, pos=X_WH[:3, 3], quat=quat_wxyz_from_rotation(X_WH[:3, :3])
        )
        bodies[name].add_site(name=RECEPTACLE + name, group=4)
        spec.add_sensor(
            name=RECEPTACLE + name,
            type=mujoco.mjtSensor.mjSENS_FORCE,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=RECEPTACLE + name,
        )

    # The walls belong to the receptacles.
    for solid in panel.fixed:
        of = next((name for name in RECEPTACLES if solid.name.startswith(f"panel_{name}_")), "")
        X_HT = inverse(panel.hole(of).pose(np.eye(4))) if of else np.eye(4)
        geom = replace(solid, X_TS=X_HT @ solid.X_TS).add_to(bodies[of] if of else block)
        geom.mass = 0.0

    if seat.debris:
        _add_debris(bodies[panel.end], panel.hole(panel.end))


def _add_debris(receptacle: "mujoco.MjsBody", hole: Hole) -> None:
    """Fill a receptacle with debris."""
    import mujoco

    half = 0.5 * (hole.depth - DEBRIS)
    receptacle.add_geom(
        name="debris",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[hole.radius, half, 0.0],
        pos=[0.0, 0.0, DEBRIS + half],
        mass=0.0,
        rgba=[0.35, 0.3, 0.2, 1.0],
    )


def _add_plug(spec: "mujoco.MjSpec", panel: PluggedPanel, X_WT: Array, seat: Seat) -> float:
    """Add the plug as a free body in the panel's frame; returns its inverse weight [1/kg]."""
    import mujoco

    place = {"pos": X_WT[:3, 3], "quat": quat_wxyz_from_rotation(X_WT[:3, :3])}
    plug = spec.worldbody.add_body(name=TARGET_BODY, **place)
    plug.add_freejoint()
    size = np.array([2.0 * COLLAR[0], 2.0 * COLLAR[0], PIN[1] + COLLAR[1] + HANDLE[2]])
    plug.mass = panel.mass
    plug.ipos = panel.center
    plug.inertia = panel.mass / 12.0 * (np.sum(size**2) - size**2)
    plug.explicitinertial = True
    for solid in panel.plug:
        geom = solid.add_to(plug)
        geom.mass = 0.0
        geom.priority = 1
        geom.friction = FRICTION
        geom.condim = 4
        geom.solref = _SOLREF
        geom.solimp = _SOLIMP

    if seat.stuck:
        weld = spec.add_equality(name="stuck", type=mujoco.mjtEq.mjEQ_WELD)
        weld.name1 = TARGET_BODY
        weld.name2 = RECEPTACLE + panel.start
        weld.objtype = mujoco.mjtObj.mjOBJ_BODY
        weld.solref = _SOLREF
        # The middle of the plug in both frames, and the receptacle's attitude in the plug's.
        X_TH = panel.hole(panel.start).pose(np.eye(4))
        center_H = transform_points(inverse(X_TH), panel.center)
        weld.data[:6] = [*center_H, *panel.center]
        weld.data[6:11] = [*quat_wxyz_from_rotation(X_TH[:3, :3]), 1.0]

    # An ellipsoid's added mass and drag, with the plug's own volume.
    density = hydrodynamics.density_of(spec)
    water = hydrodynamics.ellipsoid(0.5 * size, center=panel.center, water_density=density)
    water = replace(water, volume=panel.volume)
    hydrodynamics.attach(spec, {TARGET_BODY: water})
    return float(np.mean(1.0 / (panel.mass + np.diag(water.added_mass)[:3])))


def _add_seal(spec: "mujoco.MjSpec", name: str, seat: Seat, weight: float) -> None:
    """Add the beads of a receptacle's seal, and their contacts with the pin.

    Args:
        spec: scene, changed.
        name: of the receptacle.
        seat: its friction.
        weight: [1/kg] inverse weight of the plug.
    """
    import mujoco

    press = seat.friction / (BEADS * SEAL_FRICTION * SEAL_STIFFNESS)
    away = PIN[0] - press + BEAD
    compliance = (1.0 - _SEAL_IMPEDANCE) * weight * SEAL_STIFFNESS
    time = float(np.sqrt(1.0 / compliance))

    receptacle = spec.body(RECEPTACLE + name)
    for number in range(BEADS):
        side = exp_so3([0.0, 0.0, 2.0 * np.pi * number / BEADS]) @ [away, 0.0, 0.0]
        bead = f"seal_{name}_{number}"
        receptacle.add_geom(
            name=bead,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[BEAD, 0.0, 0.0],
            pos=side + SEAL_DEPTH * _INWARDS,
            mass=0.0,
            contype=0,
            conaffinity=0,
            rgba=[0.15, 0.15, 0.15, 1.0],
        )
        pair = spec.add_pair(geomname1=bead, geomname2="target_pin")
        pair.condim = 3
        pair.friction = [SEAL_FRICTION, SEAL_FRICTION, 0.0, 0.0, 0.0]
        pair.solref = [time, 1.0]
        pair.solreffriction = [_SEAL_FRICTION_TIME, 1.0]
        pair.solimp = [_SEAL_IMPEDANCE, _SEAL_IMPEDANCE, 0.001, 0.5, 2.0]
