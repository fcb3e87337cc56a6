"""Start of a run: a pose drawn around the task's pose, and its clearance from everything else."""

from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from uuv.models.naming import of_geom
from uuv.models.vehicle import Vehicle
from uuv.scenario import PlacedTask
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, quat_wxyz_from_rotation

_DEEP = 0.005  # [m] in something; contact of less is left to the physics
_WITHIN = 0.5  # [m] within which the nearest part of the site is looked for


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunStreams:
    """Random streams of a run, in the order in which they are spawned once the site is drawn."""

    gusts: np.random.Generator
    noise: np.random.Generator  # of the sensors
    start: np.random.Generator
    sampling: np.random.Generator  # of the finder

    @classmethod
    def of(cls, rng: np.random.Generator) -> Self:
        """The streams of a generator that has drawn the site."""
        gusts, noise, start, sampling = rng.spawn(4)
        return cls(gusts=gusts, noise=noise, start=start, sampling=sampling)


def start_pose(placed: PlacedTask, rng: np.random.Generator) -> Array:
    """Pose X_WB (4, 4) at which a run begins: up to 3 cm and 0.02 rad of yaw off the task's."""
    offset = pose(exp_so3([0.0, 0.0, rng.uniform(-0.02, 0.02)]), rng.uniform(-0.03, 0.03, 3))
    return placed.X_WB if placed.exact_start else placed.X_WB @ offset


@dataclass(frozen=True, slots=True, kw_only=True)
class Clearance:
    """Distance of a vehicle to the nearest thing that is not part of it."""

    distance: float  # [m]; negative: so deep in it; inf: nothing within 0.5 m
    between: str = ""  # the thing and the part of the vehicle

    def __str__(self) -> str:
        """The clearance in words."""
        if self.distance < 0.0:
            return f"{-self.distance:.2f} m deep in {self.between}"
        return f"{self.distance:.2f} m clear of {self.between}"


def folded_at(
    model: mujoco.MjModel, vehicle: Vehicle, X_WB: Array, q: Array | None = None
) -> mujoco.MjData:
    """State of a model, kinematics computed, with the hull at X_WB (4, 4) and the arm at `q` (n,);
    None: at home.
    """
    data = mujoco.MjData(model)
    data.qpos[vehicle.hull_qpos : vehicle.hull_qpos + 3] = X_WB[:3, 3]
    data.qpos[vehicle.hull_qpos + 3 : vehicle.hull_qpos + 7] = quat_wxyz_from_rotation(X_WB[:3, :3])
    data.qpos[vehicle.qpos] = vehicle.q_home if q is None else q
    mujoco.mj_kinematics(model, data)
    return data


def clearance(
    model: mujoco.MjModel,
    vehicle: Vehicle,
    X_WB: Array,
    q: Array | None = None,
    within: float = _WITHIN,
) -> Clearance:
    """Clearance of a vehicle at a pose of its hull.

    Args:
        model: Of the scene, with the vehicle; its margins of contact are put back.
        vehicle: The vehicle in it.
        X_WB: (4, 4) pose of the hull.
        q: (n,) joint angles; None: at home.
        within: [m] within which the nearest part is looked for; beyond, the clearance is infinite.
    """
    root = np.asarray(model.body_rootid)[np.asarray(model.geom_bodyid)]
    ours = root == model.body_rootid[vehicle.hull]

    # Contacts count from a margin on, which is widened for the vehicle's own geoms.
    data = folded_at(model, vehicle, X_WB, q)
    margin = model.geom_margin.copy()
    model.geom_margin[ours] = within
    try:
        mujoco.mj_collision(model, data)
    finally:
        model.geom_margin[:] = margin

    nearest = min(
        (contact for contact in data.contact if ours[contact.geom[0]] != ours[contact.geom[1]]),
        key=lambda contact: contact.dist,
        default=None,
    )
    if nearest is None:
        return Clearance(distance=np.inf)
    part, other = sorted(nearest.geom.tolist(), key=lambda geom: not ours[geom])
    between = f"{of_geom(model, other)} with {of_geom(model, part)}"
    return Clearance(distance=float(nearest.dist), between=between)


def start_refusal(model: mujoco.MjModel, vehicle: Vehicle, X_WB: Array) -> str:
    """Reason why a vehicle cannot start at a hull pose (4, 4), a penetration; empty if it can."""
    clear = clearance(model, vehicle, X_WB)
    if clear.distance >= -_DEEP:
        return ""
    return (
        f"the vehicle would start {clear}; its start follows from position and tilt of the camera "
        "and from task.range"
    )
