"""Figures of a vehicle at rest: trim, thrust along each axis, reach, tip force, joint loads."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import undriven_axes
from uuv.models.completing.postures import PostureSearch
from uuv.models.naming import HOME_KEY
from uuv.models.vehicle import Vehicle
from uuv.models.water import battery_feed
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import curves
from uuv.sim.interfaces.spatial import Array, spread_directions
from uuv.sim.plant.supply import all_ahead

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
FASTEST = 2.0  # [m/s] fastest current that is tried
_DIRECTIONS = 60  # number of directions in which a force on the tip is tried
# shells of the ball before the camera; distance to a drawn tip that counts as reached / reach
_SHELLS, _NEAR = 6, 0.1
_SMALL = 1e-9  # [N], [m] or [N m] that counts as zero


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trim:
    """Weight and hydrostatic forces of the level, motionless vehicle in one posture."""

    force: float  # [N] net force, upwards
    roll: float  # [rad] at which moments balance; NaN: there is no such attitude
    pitch: float  # [rad]
    height: float  # [m] height of the centre of buoyancy above the centre of mass
    apart: float  # [m] horizontally between the two


def resting(model: mujoco.MjModel, vehicle: Vehicle, key: str) -> mujoco.MjData:
    """State at rest, with forces, in the posture of a keyframe or, without it, the reference
    posture; the hull is level and its axes are parallel to the world's.
    """
    data = mujoco.MjData(model)
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, key)
    if number >= 0:
        mujoco.mj_resetDataKeyframe(model, data, number)
    data.qpos[vehicle.hull_qpos + 3 : vehicle.hull_qpos + 7] = [1.0, 0.0, 0.0, 0.0]
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    return data


def weight_of(model: mujoco.MjModel, vehicle: Vehicle) -> float:
    """Weight [N] of the whole vehicle in air."""
    root = int(model.body_rootid[vehicle.hull])
    return float(model.body_subtreemass[root]) * float(np.linalg.norm(model.opt.gravity))


def trim_of(model: mujoco.MjModel, vehicle: Vehicle, key: str = HOME_KEY) -> Trim:
    """Trim in the posture of a keyframe; the water's callback must be installed."""
    data = resting(model, vehicle, key)
    at = slice(vehicle.hull_dof, vehicle.hull_dof + 6)
    wrench = data.qfrc_passive[at] - data.qfrc_bias[at]

    root = int(model.body_rootid[vehicle.hull])
    lift = float(wrench[2]) + weight_of(model, vehicle)
    center = data.xmat[vehicle.hull].reshape(3, 3).T @ (
        data.subtree_com[root] - data.xpos[vehicle.hull]
    )
    # The righting moment at a small angle of tilt is lift * height * angle.
    about_mass = wrench[3:] - np.cross(center, wrench[:3])
    height = _height(model, vehicle, data, lift)
    righting = lift * height

    if righting > _SMALL:
        roll, pitch = (float(np.arctan2(moment, righting)) for moment in about_mass[:2])
    else:
        roll = pitch = float("nan")

    apart = float(np.linalg.norm(about_mass[:2])) / max(lift, _SMALL)
    return Trim(force=float(wrench[2]), roll=roll, pitch=pitch, height=height, apart=apart)


@dataclass(frozen=True, slots=True, kw_only=True)
class Listing:
    """List of a hull about the axes that no thrusters drive, from statics."""

    axes: tuple[str, ...]  # "roll", "pitch", or both
    moment: float  # [N m] that weight and buoyancy have to balance
    righting: float  # [N m/rad] W h; not positive: the hull turns over
    angle: float  # [rad] at which they balance it; NaN: there is none

    def in_words(self) -> str:
        """The list as a sentence."""
        named = " and ".join(self.axes)
        if not self.angle >= 0.0:
            return f"no thruster drives {named}, and weight and buoyancy do not right the hull"
        return (
            f"no thruster drives {named}: {self.moment:.1f} N m against W h = {self.righting:.3g} "
            f"N m/rad list the hull by {np.degrees(self.angle):.1f} deg"
        )


def listing_of(
    model: mujoco.MjModel, vehicle: Vehicle, q: Array, f_tip_G: Array | None = None
) -> Listing | None:
    """List at joint angles `q` (n,) under a force (3,) [N] on the tip, tool axes.

    The thrusters balance the axes that they drive with least effort; their moments about the other
    axes are included. None: they drive all axes.
    """
    axes = undriven_axes(vehicle.thruster_wrench)
    if not axes:
        return None
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[vehicle.hull_qpos + 3 : vehicle.hull_qpos + 7] = [1.0, 0.0, 0.0, 0.0]
    data.qpos[vehicle.qpos] = q
    mujoco.mj_forward(model, data)

    # Wrench on the hull at its origin, level and at rest.
    at = slice(vehicle.hull_dof, vehicle.hull_dof + 6)
    wrench = np.array(data.qfrc_passive[at] - data.qfrc_bias[at])
    lift = float(wrench[2]) + weight_of(model, vehicle)
    if f_tip_G is not None and vehicle.tip >= 0:
        force = data.site_xmat[vehicle.tip].reshape(3, 3) @ f_tip_G
        lever = data.site_xpos[vehicle.tip] - data.xpos[vehicle.hull]
        wrench += np.concatenate([force, np.cross(lever, force)])

    spared = [AXES.index(axis) for axis in axes]
    driven = [i for i in range(6) if i not in spared]
    B = vehicle.thruster_wrench
    left = wrench + B @ (np.linalg.pinv(B[driven]) @ -wrench[driven])
    moment = float(np.linalg.norm(left[spared]))
    righting = lift * _height(model, vehicle, data, lift)
    angle = float(np.arctan(moment / righting)) if righting > _SMALL else float("nan")
    return Listing(axes=axes, moment=moment, righting=righting, angle=angle)


def _height(model: mujoco.MjModel, vehicle: Vehicle, data: mujoco.MjData, lift: float) -> float:
    """Height [m] of the centre of buoyancy above that of mass: the lever arm at 90 deg of roll."""
    rolled = mujoco.MjData(model)
    rolled.qpos[:] = data.qpos
    at = vehicle.hull_qpos
    rolled.qpos[at + 3 : at + 7] = [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    mujoco.mj_forward(model, rolled)

    # Moment about the centre of mass, in the hull's frame.
    dof = slice(vehicle.hull_dof, vehicle.hull_dof + 6)
    wrench = rolled.qfrc_passive[dof] - rolled.qfrc_bias[dof]
    R = rolled.xmat[vehicle.hull].reshape(3, 3)
    root = int(model.body_rootid[vehicle.hull])
    center = R.T @ (rolled.subtree_com[root] - rolled.xpos[vehicle.hull])
    moment = wrench[3:] - np.cross(center, R.T @ wrench[:3])
    return -float(moment[0]) / max(abs(lift), _SMALL)


def bounds_of(vehicle: Vehicle) -> list[tuple[float, float]]:
    """Thrust [N] at full astern and full ahead of each thruster."""
    return [
        (thrust_at(curve, -1.0), thrust_at(curve, 1.0)) for curve in curves(vehicle.thruster_table)
    ]


def full_draw(model: mujoco.MjModel) -> str:
    """Current and power of all thrusters full ahead, in words; empty without measured currents."""
    drawn = all_ahead(model)
    if drawn is None:
        return ""

    # The battery without load, and its voltage under this load.
    full, _, charge, resistance = battery_feed.numbers_of(model).tolist()
    under = f"{drawn.current:.0f} A and {drawn.power:.0f} W with all thrusters full ahead"
    if not charge:
        return f"constant voltage; {under}"
    return (
        f"battery {full:g} V, {charge / 3600.0:g} A h, {resistance:g} ohm; drops to "
        f"{drawn.voltage:.1f} V, {under}"
    )


def authority(vehicle: Vehicle, axis: int, B: Array | None = None) -> tuple[float, float]:
    """Largest force or moment against and along an axis, all others being zero; both positive.

    Args:
        vehicle: The vehicle.
        axis: Index in AXES.
        B: (6, m) wrench of unit thrusts in place of the vehicle's.
    """
    from scipy.optimize import linprog

    B = vehicle.thruster_wrench if B is None else B
    if not B.size:
        return 0.0, 0.0

    others = np.delete(B, axis, axis=0)
    # axes that no thruster drives are zero in any case
    rank = [row for row in others if np.abs(row).max() > _SMALL]
    equal = {"A_eq": np.array(rank), "b_eq": np.zeros(len(rank))} if rank else {}

    largest = []
    for sign in (1.0, -1.0):
        solved = linprog(sign * B[axis], bounds=bounds_of(vehicle), **equal)
        largest.append(abs(float(solved.fun)) if solved.success else 0.0)
    return largest[0], largest[1]


def strongest_current(model: mujoco.MjModel, vehicle: Vehicle, axis: int, force: float) -> float:
    """Speed [m/s] of a current along an axis at which the drag is `force` [N], at most FASTEST."""
    data = resting(model, vehicle, HOME_KEY)
    at = vehicle.hull_dof + axis
    still = float(data.qfrc_passive[vehicle.hull_dof + axis])

    def drag(speed: float) -> float:
        data.qvel[:] = 0.0
        data.qvel[at] = speed
        mujoco.mj_forward(model, data)
        return abs(float(data.qfrc_passive[at]) - still)

    low, high = 0.0, FASTEST
    if drag(high) < force:
        return high
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if drag(middle) < force else (low, middle)
    return low


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TipForce:
    """Force at the tip that the drives can apply in one posture, while they hold the arm up."""

    along: float  # [N] along the tool, pushing
    weakest: float  # [N] in the weakest of the tried directions
    by: str  # joint that limits the push along the tool
    weakest_by: str  # joint that limits in the weakest direction
    load: Array  # (n,) share of each joint's torque limit that weight and buoyancy take
    friction: float  # [N] along the tool that the gears' stiction can hide


def tip_force(model: mujoco.MjModel, vehicle: Vehicle, q: Array) -> TipForce:
    """Force at the tip at joint angles `q` (n,), level and at rest."""
    arm = ArmDynamics(model)
    rest = np.zeros(len(q))
    n = len(q)
    still = {"R_WB": np.eye(3), "nu_B": np.zeros(6), "a_B": np.zeros(6), "v_current_W": np.zeros(3)}

    # Torque of the weight alone, and the torque that each newton at the tip adds.
    of_weight = arm.inverse(q, rest, rest, wrench_tip_G=np.zeros(6), **still)[0]
    per_newton = np.array(
        [
            arm.inverse(q, rest, rest, wrench_tip_G=np.concatenate([axis, np.zeros(3)]), **still)[0]
            for axis in np.eye(3)
        ]
    )
    per_newton = per_newton - of_weight  # (3, n) [m]
    spare = np.maximum(vehicle.torque_limits - np.abs(of_weight), 0.0)

    def most(direction_G: Array) -> tuple[float, int]:
        lever = np.abs(direction_G @ per_newton)
        bears = np.where(lever > _SMALL, spare / np.maximum(lever, _SMALL), np.inf)
        return float(bears.min()), int(np.argmin(bears))

    along, by = most(np.array([0.0, 0.0, -1.0]))
    weakest, weak_by = min(
        (most(direction) for direction in spread_directions(_DIRECTIONS)),
        key=lambda by_direction: by_direction[0],
    )

    lever = np.abs(per_newton[2])
    felt = lever > _SMALL
    hidden = (
        float((vehicle.dry_friction.stiction[felt] / lever[felt]).min())
        if n and felt.any()
        else 0.0
    )

    return TipForce(
        along=along,
        weakest=weakest,
        by=vehicle.joint_names[by],
        weakest_by=vehicle.joint_names[weak_by],
        load=np.abs(of_weight) / vehicle.torque_limits,
        friction=hidden,
    )


def seen_workspace(search: PostureSearch, X_BC: Array) -> float:
    """Share of the volume in front of the camera that the tip reaches.

    The volume is a ball whose diameter is the arm's reach.

    Args:
        search: Search of the arm's postures.
        X_BC: (4, 4) pose of the camera on the hull; the ball touches it.
    """
    from scipy.spatial import cKDTree

    radius = 0.5 * search.reach
    centre = X_BC[:3, 3] + radius * X_BC[:3, 2]

    shells = np.cbrt((np.arange(_SHELLS) + 0.5) / _SHELLS)  # of equal volume
    points = np.vstack(
        [centre + radius * share * spread_directions(_DIRECTIONS) for share in shells]
    )

    away, _ = cKDTree(search.drawn_tips()).query(points)
    return float(np.mean(away < _NEAR * search.reach))
