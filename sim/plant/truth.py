"""True state of one plant, for sensors, judges and recordings; no component of the vehicle may read
it.
"""

from typing import Self

import mujoco
import numpy as np

from uuv.models.naming import USUAL_NAMES, PartNames
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.jaw_drive import TrueJaws
from uuv.sim.plant.readout import FORCE
from uuv.sim.plant.thrusters import Drive
from uuv.sim.plant.true_handle import Mechanisms, TrueHandle
from uuv.sim.plant.true_receptacles import TrueReceptacles


class Truth:
    """True state at the start of the plant's step. The arrays are views, to be read before the next
    step.

    Positions and velocities are those at `time`. Accelerations and torques are those of the
    preceding physics step, at which a sensor would have sampled them. The fields of contact cover
    all substeps of the preceding step of the plant.
    """

    __slots__ = (
        "R_WB",
        "R_WG",
        "acceleration",
        "arm_wrench_B",
        "collided",
        "collision",
        "contact_force_W",
        "contact_least",
        "contact_most",
        "contact_normal",
        "current_W",
        "joint_damping",
        "mechanisms",
        "p_WB",
        "p_WG",
        "p_pad",
        "propeller_speed",
        "q",
        "qd",
        "qdd",
        "saturated",
        "tau_drive",
        "tau_friction",
        "thrust",
        "time",
        "v_WB_W",
        "vehicle",
        "w_WB_B",
        "xmat",
        "xpos",
        "xquat",
    )

    time: float  # [s]
    xpos: Array  # (nbody, 3) [m] body origins in W
    xquat: Array  # (nbody, 4) wxyz
    xmat: Array  # (nbody, 9)
    p_WB: Array  # (3,) [m]
    R_WB: Array  # (3, 3)
    v_WB_W: Array  # (3,) [m/s], world axes
    w_WB_B: Array  # (3,) [rad/s], hull axes
    acceleration: Array  # (6,) of the free joint: linear in W, angular in B [m/s^2, rad/s^2]
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    qdd: Array  # (n,) [rad/s^2]
    tau_drive: Array  # (n,) [N m] of the motors
    tau_friction: Array  # (n,) [N m] of dry friction in the gears, on the joint
    joint_damping: Array  # (n,) [N m s/rad]
    propeller_speed: Array  # (m,) normalised propeller speed, which lags the commands
    thrust: Array  # (m,) [N] in the last physics step
    saturated: bool  # a thruster command was at its limit
    current_W: Array  # (3,) [m/s]
    mechanisms: Mechanisms  # jaws of a gripper; handle of a valve, receptacles of a panel
    # (6,) [N, N m] wrench of the arm on the hull, at the hull's origin; NaN if the plant does not
    # measure it
    arm_wrench_B: Array
    p_WG: Array  # (3,) [m] tip of the rigid tool; without an arm, the origin of the hull
    R_WG: Array  # (3, 3) tool axes
    p_pad: Array  # (3,) [m] face of the pad, which moves along the tool axis on its spring
    contact_normal: float  # [N] sum of the normal forces on the pad, mean over the substeps
    contact_least: float  # [N] smallest value of that sum in a substep
    contact_most: float  # [N] largest value of that sum in a substep
    contact_force_W: Array  # (3,) [N] of the world on the pad, mean over the substeps
    collision: bool  # another part of the vehicle was in contact with the world in any substep
    # (3,) first such geoms of vehicle and world, and the time [s]; negative if there were none
    collided: Array
    vehicle: Vehicle

    @property
    def jaws(self) -> TrueJaws:
        """Jaws of a gripper."""
        return self.mechanisms.jaws

    @property
    def handle(self) -> TrueHandle:
        """Handle of a valve at the site."""
        return self.mechanisms.handle

    @property
    def receptacles(self) -> TrueReceptacles:
        """Receptacles of a panel at the site."""
        return self.mechanisms.receptacles

    @property
    def armature(self) -> Array:
        """Inertia (n,) [kg m^2] of rotors and gears at the joints."""
        return self.vehicle.armature

    @classmethod
    def of(
        cls,
        data: mujoco.MjData,
        vehicle: Vehicle,
        drive: Drive,
        contacts: Array,
        pad_site: int,
        names: PartNames = USUAL_NAMES,
    ) -> Self:
        """Truth whose arrays are views, made once to avoid lookups in the loop.

        Args:
            data: State of the simulation.
            vehicle: Vehicle in the simulation.
            drive: Thrusters of the vehicle.
            contacts: (CONTACTS,) sums from `uuv.sim.plant.readout`.
            pad_site: Site of the pad's face; -1 for none.
            names: Names of the vehicle's parts.

        Returns:
            The truth. The plant sets the fields that are numbers.
        """
        truth = cls()
        truth.vehicle = vehicle

        truth.xpos = data.xpos
        truth.xquat = data.xquat
        truth.xmat = data.xmat

        # Hull.
        truth.p_WB = data.xpos[vehicle.hull]
        truth.R_WB = data.xmat[vehicle.hull].reshape(3, 3)
        dof = vehicle.hull_dof
        truth.v_WB_W = data.qvel[dof : dof + 3]
        truth.w_WB_B = data.qvel[dof + 3 : dof + 6]
        truth.acceleration = data.qacc[dof : dof + 6]

        # Arm and thrusters.
        truth.q = _view(data.qpos, vehicle.qpos)
        truth.qd = _view(data.qvel, vehicle.dof)
        truth.qdd = _view(data.qacc, vehicle.dof)
        truth.tau_friction = np.zeros(len(vehicle.joints))
        truth.tau_drive = _view(data.qfrc_actuator, vehicle.dof)
        truth.joint_damping = vehicle.damping_in(data.model)
        truth.propeller_speed = drive.speed
        truth.thrust = drive.thrust

        truth.current_W = np.zeros(3)
        truth.mechanisms = Mechanisms.of(data, names.gripper)
        truth.arm_wrench_B = np.full(6, np.nan)

        # Tool; without an arm, the hull takes its place.
        armed = vehicle.tip >= 0
        truth.p_WG = data.site_xpos[vehicle.tip] if armed else truth.p_WB
        truth.R_WG = data.site_xmat[vehicle.tip].reshape(3, 3) if armed else truth.R_WB
        truth.p_pad = data.site_xpos[pad_site] if pad_site >= 0 else truth.p_WB

        truth.contact_force_W = contacts[FORCE : FORCE + 3]
        truth.collided = np.full(3, -1.0)
        return truth


def _view(array: Array, addresses: np.ndarray) -> Array:
    """Slice of `array` at `addresses`, which must be evenly spaced so that it stays a view."""
    if not len(addresses):
        return np.zeros(0)
    first = int(addresses[0])
    step = spacing(addresses)
    if not step:
        raise ConfigurationError(
            "the driven joints of the arm must be evenly spaced in the model: none, or the same "
            "number of other joints after each"
        )
    return array[first : first + step * len(addresses) : step]


def spacing(addresses: np.ndarray) -> int:
    """Difference of neighbouring `addresses`; 0 if it is not the same for all, or not positive."""
    steps = np.diff(addresses)
    if not len(steps):
        return 1
    return int(steps[0]) if np.all(steps == steps[0]) and steps[0] > 0 else 0
