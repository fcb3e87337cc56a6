"""Likely faults of a vehicle, each a figure that is compared with a bound."""

from collections.abc import Iterator

import mujoco
import numpy as np

from uuv.check.findings import VehicleFinding
from uuv.check.statics import AXES, TipForce, Trim, authority
from uuv.controllers.hull.allocation import undriven_axes
from uuv.models import hydrodynamics as coefficients
from uuv.models.completing.postures import PostureSearch
from uuv.models.hydrodynamics import LAYOUT
from uuv.models.naming import CAMERA_SITE, HOME_KEY, READY_KEY, TOOL_GEOM, find
from uuv.models.vehicle import Vehicle, pose_in_body
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.loop.rollout import ticks_per_period
from uuv.sim.sensors.depth_camera import OPTICS
from uuv.sim.sensors.proprioception import Encoders

HEAVY = 0.005  # largest net force at rest, as a share of the weight
LEAST_HEAVY = 5.0  # [N] net force at rest that is allowed in any case
LIST = float(np.radians(5.0))  # [rad] largest list or trim at rest
VAST = 10.0  # [m] extent of a body's shapes above which their unit is doubted
LIGHT = 1e-3  # share of the vehicle's mass below which a fixed body's inertia does not matter
LOADED = 0.5  # largest share of a joint's torque for the arm's own weight in water
BLOCKED = 0.15  # largest share of the camera's rays that hit the vehicle, with the arm at home
SLENDER = 0.08  # least radius of gyration, as a share of the body's extent
BULKY = 1.5  # largest radius of gyration, as such a share
JERKY = 30.0  # [rad/s] largest speed that a joint may gain at full torque in one time step
FLIPPED = 0.5  # ratio of touching postures, below which a joint's axis is likely reversed
OFTEN = 0.2  # share of touching postures above which a reversed axis is searched for
# ratio to the largest component of an undriven direction, above which an axis is named too
MIXED = 0.2
STEP = 0.5  # largest share of the time step at which drag would become unstable

HALF_VIEW = float(np.arctan(0.5 * OPTICS.width / OPTICS.focal))  # [rad] depth camera's half angle


def trim_doubts(trim: Trim, weight: float) -> Iterator[VehicleFinding]:
    """Doubts about a vehicle that is too heavy or too light, or that lists."""
    most = max(HEAVY * weight, LEAST_HEAVY)
    if abs(trim.force) > most:
        word = "light" if trim.force > 0.0 else "heavy"
        yield VehicleFinding(
            code="trim",
            level="doubt",
            said=f"too {word} by {abs(trim.force):.0f} N ({abs(trim.force) / 9.81:.1f} kg), "
            f"{abs(trim.force) / weight:.1%} of its weight (limit {most:.0f} N): correct the "
            "hull's volume, or set `trim:` in the mapping",
            figure=trim.force,
        )

    angle = max(abs(trim.roll), abs(trim.pitch))
    if not angle <= LIST:  # NaN as well: it turns over
        motion = "turns over" if not np.isfinite(angle) else f"lists by {np.degrees(angle):.0f} deg"
        yield VehicleFinding(
            code="list",
            level="doubt",
            said=f"at rest with the arm at home it {motion} (limit {np.degrees(LIST):.0f} deg): "
            f"centre of buoyancy {1e3 * trim.height:.0f} mm above and {1e3 * trim.apart:.0f} "
            "mm beside the centre of mass",
            figure=float(np.degrees(angle)),
        )


def inertia_doubts(model: mujoco.MjModel) -> Iterator[VehicleFinding]:
    """Principal inertias that are impossible, or implausible for the body's mass and size."""
    for b in range(1, model.nbody):
        mass = float(model.body_mass[b])
        name = model.body(b).name or f"body {b}"
        inertia = np.sort(np.array(model.body_inertia[b]))
        geoms = [g for g in range(model.ngeom) if model.geom_bodyid[g] == b]

        negligible = mass < LIGHT * float(model.body_subtreemass[model.body_rootid[b]])
        if mass <= 0.0 or not inertia[2] > 0.0 or (negligible and not model.body_jntnum[b]):
            continue

        # The largest moment is at most the sum of the others.
        if inertia[2] > 1.001 * (inertia[0] + inertia[1]):
            yield VehicleFinding(
                code="inertia",
                level="doubt",
                said=f"{name}: principal inertia {inertia[2]:.3g} kg m^2 exceeds the sum of the "
                f"others, {inertia[0] + inertia[1]:.3g}: physically impossible",
                figure=float(inertia[2]),
            )

        # The radius of gyration against the size of its shapes.
        extent = max(
            (
                float(np.linalg.norm(model.geom_pos[g] - model.body_ipos[b]))
                + float(model.geom_rbound[g])
                for g in geoms
            ),
            default=0.0,
        )

        gyration = float(np.sqrt(inertia[2] / mass))
        meshed = any(model.geom_type[g] == mujoco.mjtGeom.mjGEOM_MESH for g in geoms)
        if meshed and extent > VAST and (unit := _unit_of(gyration, extent)):
            yield VehicleFinding(
                code="inertia",
                level="doubt",
                said=f"{name}: its shapes are {extent:.3g} m wide, but its radius of gyration is "
                f"{1e3 * gyration:.0f} mm: the mesh is probably in {unit[0]}; set "
                f'scale="{unit[1]}" in its <mesh>',
                figure=gyration,
            )
        elif extent > 0.0 and not SLENDER * extent <= gyration <= BULKY * extent:
            yield VehicleFinding(
                code="inertia",
                level="doubt",
                said=f"{name}: {inertia[2]:.2g} kg m^2 and {mass:.3g} kg give a radius of "
                f"gyration of {1e3 * gyration:.0f} mm; for the size of its shapes, "
                f"{1e3 * SLENDER * extent:.0f} to {1e3 * BULKY * extent:.0f} mm are "
                "plausible",
                figure=gyration,
            )


def _unit_of(gyration: float, extent: float) -> tuple[str, str] | None:
    """Likely length unit, and its scale, of shapes [m] too large for a radius of gyration [m]."""
    for unit, factor in (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)):
        if SLENDER * extent * factor <= gyration <= BULKY * extent * factor:
            return unit, f"{factor:g} {factor:g} {factor:g}"
    return None


def water_doubts(model: mujoco.MjModel, vehicle: Vehicle) -> Iterator[VehicleFinding]:
    """Missing and implausible coefficients, and a time step that is near the limit by drag."""
    # Bodies with mass and no coefficients; a body welded to one that has some is part of it.
    watered = {
        int(model.body_weldid[b])
        for b in range(1, model.nbody)
        if coefficients.carries(model.body_user[b])
    }
    dry = [
        model.body(b).name or f"body {b}"
        for b in range(1, model.nbody)
        if int(model.body_rootid[b]) == int(model.body_rootid[vehicle.hull])
        and float(model.body_mass[b]) > 0.0
        and int(model.body_weldid[b]) not in watered
    ]

    if dry:
        yield VehicleFinding(
            code="no-water",
            level="doubt" if model.body(vehicle.hull).name not in dry else "fault",
            said=f"no hydrodynamic coefficients: {', '.join(dry)} ({len(dry)} bodies with mass)",
            figure=float(len(dry)),
        )

    for doubt in hydrodynamics.doubts(model):
        if not doubt.startswith("movable bodies without water"):
            yield VehicleFinding(code=_code_of(doubt), level="doubt", said=doubt)

    if coefficients.is_wet(model):
        rate = drag_rate(model)
        share = float(model.opt.timestep) * rate
        if share > STEP:
            yield VehicleFinding(
                code="timestep",
                level="doubt",
                said=f"time step {1e3 * model.opt.timestep:g} ms is {share:.0%} of the limit by "
                f"drag at {hydrodynamics.DRAG_SPEED:g} m/s (allowed {STEP:.0%}): use "
                f"{1e3 * STEP / rate:.2g} ms or less",
                figure=share,
            )


def step_doubts(model: mujoco.MjModel) -> Iterator[VehicleFinding]:
    """A time step that does not divide the period of sensors and control."""
    try:
        ticks_per_period(Encoders().period, float(model.opt.timestep), "time step")
    except ConfigurationError as error:
        yield VehicleFinding(
            code="timestep", level="fault", said=str(error), figure=float(1e3 * model.opt.timestep)
        )


def gravity_doubts(model: mujoco.MjModel, vehicle: Vehicle) -> Iterator[VehicleFinding]:
    """Bodies whose weight MuJoCo cancels in addition to buoyancy, and gravity that is not down."""
    root = int(model.body_rootid[vehicle.hull])
    light = [
        b
        for b in range(1, model.nbody)
        if model.body_rootid[b] == root and model.body_gravcomp[b] != 0.0
    ]

    if light:
        names = ", ".join(model.body(b).name or f"body {b}" for b in light)
        yield VehicleFinding(
            code="gravcomp",
            level="fault",
            said=f"gravcomp cancels the weight of {names}, although buoyancy bears it: remove "
            "gravcomp",
            figure=float(model.body_gravcomp[light].max()),
        )

    if not model.opt.gravity[2] < 0.0:
        yield VehicleFinding(
            code="gravity",
            level="doubt",
            said=f"gravity is {' '.join(f'{g:g}' for g in model.opt.gravity)} m/s^2; here z "
            "points up and a scene has "
            "0 0 -9.81: is the file forward-starboard-down?",
            figure=float(model.opt.gravity[2]),
        )


def drag_rate(model: mujoco.MjModel) -> float:
    """Rate [1/s] of the drag at hydrodynamics.DRAG_SPEED of a wet model."""
    world = model.body_user[0]
    return float(world[LAYOUT.drag_rate]) + hydrodynamics.DRAG_SPEED * float(
        world[LAYOUT.drag_rate + 1]
    )


def _code_of(doubt: str) -> str:
    if "kg/m^3" in doubt:
        return "density"
    return "sensors" if "sensors" in doubt else "coefficients"


def stiff_contact(model: mujoco.MjModel) -> Iterator[VehicleFinding]:
    """A spring of the tool with too little damping for the time step."""
    dt = float(model.opt.timestep)
    for j in range(model.njnt):
        k = float(model.jnt_stiffness.reshape(model.njnt, -1)[j, 0])
        dof = int(model.jnt_dofadr[j])
        if k <= 0.0 or int(model.jnt_type[j]) != int(mujoco.mjtJoint.mjJNT_SLIDE):
            continue

        damping = float(np.asarray(model.dof_damping).reshape(model.nv, -1)[dof, 0])
        if damping < 0.5 * k * dt:
            yield VehicleFinding(
                code="spring",
                level="doubt",
                said=f"joint {model.joint(j).name!r}: damping {damping:.3g} N s/m with stiffness "
                f"{k:.3g} N/m; at a time step of {1e3 * dt:g} ms it needs {0.5 * k * dt:.3g} N s/m "
                "or more",
                figure=damping,
            )


def thruster_doubts(vehicle: Vehicle) -> Iterator[VehicleFinding]:
    """Axes that no thrusters drive, and thrusters that push against their mirror image."""
    B = vehicle.thruster_wrench
    if not B.size:
        return

    # Directions that no thruster drives: the rest of the left singular vectors.
    rank = int(np.linalg.matrix_rank(B, tol=1e-6))
    if rank < 6:
        missing = [
            " with ".join(
                AXES[i] for i in np.argsort(-np.abs(v)) if abs(v[i]) > MIXED * np.abs(v).max()
            )
            for v in np.linalg.svd(B)[0].T[rank:]
        ]
        righted = bool(undriven_axes(B))
        yield VehicleFinding(
            code="thruster-rank",
            level="doubt" if righted else "fault",
            said=f"the {B.shape[1]} thrusters span {rank} of 6 directions; not actuated: "
            f"{', '.join(missing)}"
            + (" (weight and buoyancy right it)" if righted else ", and no moment rights it"),
            figure=float(rank),
        )

    # Thrusters that may be reversed: the gain of each axis if one of them is reversed.
    as_built = [max(authority(vehicle, axis)) for axis in range(6)]
    for i, j in _against(B):
        turned = np.array(B)
        turned[:, i] *= -1.0
        then = [max(authority(vehicle, axis, turned)) for axis in range(6)]
        axis = int(np.argmax(np.array(then) / np.maximum(as_built, 1e-6)))
        first, second = vehicle.thruster_names[i], vehicle.thruster_names[j]

        gain = (
            f"{AXES[axis]} has {as_built[axis]:.0f}, with {first} reversed {then[axis]:.0f} "
            f"{'N' if axis < 3 else 'N m'}"
        )

        yield VehicleFinding(
            code="thruster-against-pair",
            level="doubt",
            said=f"thruster {first} pushes against its mirror image {second}: reversed? "
            + (gain if then[axis] > 1.01 * as_built[axis] else "reversing it improves no axis"),
            figure=as_built[axis],
        )


def _against(B: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of thrusters at mirrored positions in y whose unit wrenches are opposite."""
    mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    for i in range(B.shape[1]):
        for j in range(i + 1, B.shape[1]):
            image = mirror * B[:, j]
            aside = np.linalg.norm(B[:, i] - B[:, j]) > 1e-6
            if (
                aside
                and np.allclose(B[:, i], -image, atol=1e-3)
                and not np.allclose(B[:, i], image, atol=1e-3)
            ):
                yield i, j


def posture_doubts(
    search: PostureSearch, postures: dict[str, np.ndarray]
) -> Iterator[VehicleFinding]:
    """Keyframes beyond the limits or in self-contact, and joint axes that are likely reversed.

    Args:
        search: Search of the vehicle's postures.
        postures: Joint angles (n,) [rad] of each keyframe of the model.
    """
    vehicle, model = search.vehicle, search.model
    low, high = vehicle.q_limits[:, 0], vehicle.q_limits[:, 1]
    touching: dict[str, np.ndarray] = {}

    # Keyframes beyond the limits, or with shapes that touch.
    for key, q in postures.items():
        beyond = np.maximum(low - q, q - high)
        if beyond.max() > 1e-6:
            j = int(np.argmax(beyond))
            yield VehicleFinding(
                code="keyframe-limits",
                level="doubt",
                said=f"keyframe {key}: {vehicle.joint_names[j]} at {np.degrees(q[j]):.0f} deg, "
                f"its range is {np.degrees(low[j]):.0f} to {np.degrees(high[j]):.0f}",
                figure=float(np.degrees(q[j])),
            )

        pairs = search.touching(q)
        if pairs:
            touching[key] = q
            named = ", ".join(
                f"{model.body(a).name} and {model.body(b).name}" for a, b in sorted(pairs)
            )
            yield VehicleFinding(
                code="keyframe-touches",
                level="doubt",
                said=f"keyframe {key}: {named} touch ({len(pairs)} pairs)",
                figure=float(len(pairs)),
            )

    # Joints that would touch less with the other sign of their axis.
    share = search.share_touching()
    turned = (
        [search.share_touching(j) for j in range(len(low))] if share > OFTEN or touching else []
    )
    for j, then in enumerate(turned):
        freed = [
            key
            for key, q in touching.items()
            if search.is_clear(q * np.where(np.arange(len(q)) == j, -1.0, 1.0))
        ]

        if freed or (share > OFTEN and then < FLIPPED * share):
            why = f"{' and '.join(freed)} would be clear, and " if freed else ""
            yield VehicleFinding(
                code="axis-flipped",
                level="doubt",
                said=f"joint {vehicle.joint_names[j]}: its axis may be reversed; with the other "
                f"sign {why}{then:.0%} of all postures would collide, now {share:.0%}",
                figure=share,
            )


def view_doubts(search: PostureSearch, q_home: np.ndarray) -> Iterator[VehicleFinding]:
    """Doubt about a camera whose view the vehicle itself blocks."""
    share, body = search.view_hits(q_home, HALF_VIEW)
    if share > BLOCKED:
        yield VehicleFinding(
            code="camera-blocked",
            level="doubt",
            said=f"{share:.0%} of the view of {CAMERA_SITE} ({np.degrees(HALF_VIEW):.0f} deg "
            f"around its axis) is blocked by the vehicle itself, mostly by {body} (limit "
            f"{BLOCKED:.0%})",
            figure=share,
        )


def camera_pose(model: mujoco.MjModel, vehicle: Vehicle) -> np.ndarray:
    """Pose (4, 4) of the camera on the hull."""
    return pose_in_body(model, find(model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), vehicle.hull)


def motor_doubts(model: mujoco.MjModel, vehicle: Vehicle) -> Iterator[VehicleFinding]:
    """Actuators of the arm whose control is not a torque."""
    kinds = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE, mujoco.mjtDyn.mjDYN_NONE
    for actuator, joint in zip(vehicle.actuators, vehicle.joint_names, strict=True):
        kind = tuple(
            int(getattr(model, f"actuator_{word}type")[actuator])
            for word in ("gain", "bias", "dyn")
        )

        gain, gear = (
            float(model.actuator_gainprm[actuator, 0]),
            float(model.actuator_gear[actuator, 0]),
        )

        if kind != tuple(map(int, kinds)) or gain != 1.0 or gear != 1.0:
            yield VehicleFinding(
                code="motor",
                level="fault",
                said=f"the actuator of joint {joint!r} is no plain motor (gain {gain:g}, gear "
                f"{gear:g}): its control is not the torque; `joints: {{{joint}: N m}}` in a "
                "mapping replaces it by a motor",
                figure=gear,
            )


def light_joints(model: mujoco.MjModel, vehicle: Vehicle) -> Iterator[VehicleFinding]:
    """Joints that full torque accelerates too much within one step, likely for lack of rotor
    inertia.
    """
    for dof, most, joint in zip(
        vehicle.dof, vehicle.torque_limits, vehicle.joint_names, strict=True
    ):
        inertia = float(model.dof_M0[dof])
        gained = float(most) * float(model.opt.timestep) / inertia

        if gained > JERKY:
            yield VehicleFinding(
                code="light-joint",
                level="doubt",
                said=f"joint {joint}: {most:.3g} N m on {inertia:.2g} kg m^2 gain {gained:.0f} "
                f"rad/s in one step, above the limit of {JERKY:g}: is the rotor's inertia "
                "missing (armature)?",
                figure=gained,
            )


def arm_doubts(vehicle: Vehicle, force: TipForce, set_force: float) -> Iterator[VehicleFinding]:
    """Joints loaded by the arm's own weight, and a tip force that is less than the set force."""
    worst = int(np.argmax(force.load))
    if force.load[worst] > LOADED:
        yield VehicleFinding(
            code="joint-load",
            level="doubt",
            said=f"{vehicle.joint_names[worst]}: weight and buoyancy of the arm take "
            f"{force.load[worst]:.0%} of its "
            f"{vehicle.torque_limits[worst]:.3g} N m in {READY_KEY} (limit {LOADED:.0%})",
            figure=float(force.load[worst]),
        )

    if force.along < set_force:
        yield VehicleFinding(
            code="arm-weak",
            level="doubt",
            said=f"the available tip force is {force.along:.0f} N along the tool in {READY_KEY} "
            f"({force.by} is the limit), the set force is {set_force:.0f} N",
            figure=force.along,
        )


def tool_doubts(
    model: mujoco.MjModel, search: PostureSearch, q: np.ndarray
) -> Iterator[VehicleFinding]:
    """A tool that touches the hull in the folded posture, which a job would count as work."""
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM) < 0:
        return
    tool = int(model.geom_bodyid[model.geom(TOOL_GEOM).id])

    if any(tool in pair for pair in search.touching(q)):
        yield VehicleFinding(
            code="tool-touches",
            level="doubt",
            said=f"the tool touches the vehicle itself in {HOME_KEY}",
            figure=None,
        )
