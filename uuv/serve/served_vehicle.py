"""A vehicle in open water that another program drives: commands in, true motion out.

The vehicle is complete in its model, thrusters and gears included, so a step is MuJoCo's. An arm is
held at joint angles, which may be set.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models import load
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked, number
from uuv.sim.plant.arm_hold import ArmHold, hold_torque
from uuv.sim.water.water_motion import set_current

LONGEST_STEP = 0.002  # [s] of MuJoCo; a longer frame takes several
_ARM_SPEED = 0.5  # [rad/s] at which joints follow the angles that are set


@dataclass(frozen=True, slots=True, kw_only=True)
class DiveSite:
    """Place where the vehicle begins, and the water there."""

    depth: float = 1.0  # [m] of the hull's origin at the start
    current_W: Sequence[float] = (0.0, 0.0, 0.0)  # [m/s] x, y, z up
    bottom: float = math.inf  # [m] depth of a level bottom; inf: out of range

    def __post_init__(self) -> None:
        number(self.depth, "depth [m]")
        checked(self.current_W, (3,), "current [m/s]")
        if math.isnan(self.bottom) or self.bottom <= self.depth:
            raise ConfigurationError(
                f"bottom [m]: must be deeper than the start, {self.depth} m, got {self.bottom}"
            )


class ServedVehicle:
    """One vehicle in its own simulation, advanced frame by frame."""

    def __init__(self, name: str, water: DiveSite) -> None:
        """Compile the vehicle and put it into the water at rest, arm at home.

        Args:
            name: Of a named vehicle (`uuv.models.available`).
            water: Where it begins.

        Raises:
            ConfigurationError: There is no such vehicle, or it has no thrusters.
        """
        self.model = hydrodynamics.compile(load(name))
        hydrodynamics.install()
        self.vehicle = vehicle = Vehicle.of(self.model)
        if not len(vehicle.thruster_actuators):
            raise ConfigurationError(f"vehicle {name}: has no thrusters to be commanded")

        self.name = name
        self.water = water
        self.data = mujoco.MjData(self.model)
        self._hold = ArmHold(vehicle, vehicle.q_home).gains
        self._tau = np.zeros(len(vehicle.joints))
        self._qpos = slice(vehicle.hull_qpos, vehicle.hull_qpos + 7)
        self._qvel = slice(vehicle.hull_dof, vehicle.hull_dof + 6)
        self.reset()

    def reset(self) -> None:
        """Begin anew: at the start, at rest, at time 0."""
        model = self.model
        data = self.data
        home = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, "home")
        if home >= 0:
            mujoco.mj_resetDataKeyframe(model, data, home)
        else:
            mujoco.mj_resetData(model, data)

        data.qpos[self._qpos][:3] = 0.0, 0.0, -self.water.depth
        set_current(model, data, self.water.current_W)
        self.q_set = self.vehicle.q_home.copy()
        self._hold = self._hold._replace(q=self.q_set.copy())

        # Mean acceleration of the last frame, W; at rest in the end of the world's time.
        self.a_WB_W = np.zeros(3)
        mujoco.mj_forward(model, data)

    def step(self, commands: Array, duration: float) -> None:
        """Advance by one frame under constant commands.

        Args:
            commands: (m,) in [-1, 1] of the thrusters.
            duration: [s] of the frame.

        Raises:
            HydrodynamicsError: The motion diverged.
        """
        model = self.model
        data = self.data
        vehicle = self.vehicle
        steps = max(1, math.ceil(duration / LONGEST_STEP - 1e-9))
        model.opt.timestep = duration / steps

        before = data.qvel[self._qvel][:3].copy()
        data.ctrl[vehicle.thruster_actuators] = commands
        most = _ARM_SPEED * model.opt.timestep

        for _ in range(steps):
            if len(self._tau):
                self._hold.q[:] += np.clip(self.q_set - self._hold.q, -most, most)
                q = data.qpos[vehicle.qpos]
                hold_torque(self._hold, q, data.qvel[vehicle.dof], self._tau)
                data.ctrl[vehicle.actuators] = self._tau
            mujoco.mj_step(model, data)

        self.a_WB_W = (data.qvel[self._qvel][:3] - before) / duration
        hydrodynamics.check_motion(model, data)

    @property
    def time(self) -> float:
        """Simulated time [s] since the start."""
        return float(self.data.time)

    @property
    def p_WB(self) -> Array:
        """Position (3,) [m] of the hull's origin."""
        return self.data.qpos[self._qpos][:3].copy()

    @property
    def quat_WB_wxyz(self) -> Array:
        """Attitude (4,) of the hull."""
        return self.data.qpos[self._qpos][3:].copy()

    @property
    def v_WB_W(self) -> Array:
        """Velocity (3,) [m/s] of the hull's origin."""
        return self.data.qvel[self._qvel][:3].copy()

    @property
    def w_WB_B(self) -> Array:
        """Angular velocity (3,) [rad/s] of the hull, hull axes."""
        return self.data.qvel[self._qvel][3:].copy()

    @property
    def specific_force_B(self) -> Array:
        """Mean acceleration less gravity (3,) [m/s^2] over the last frame, hull axes."""
        R_WB = np.empty(9)
        mujoco.mju_quat2Mat(R_WB, self.quat_WB_wxyz)
        return R_WB.reshape(3, 3).T @ (self.a_WB_W - self.model.opt.gravity)

    @property
    def altitude(self) -> float:
        """Distance [m] from the hull's origin along its own down axis to the bottom, or inf.

        The bottom is no obstacle: below it the distance is 0.
        """
        R_WB = np.empty(9)
        mujoco.mju_quat2Mat(R_WB, self.quat_WB_wxyz)
        down = float(R_WB.reshape(3, 3)[2, 2])
        height = self.water.bottom + float(self.p_WB[2])
        return max(height, 0.0) / down if down > 0.0 else math.inf
