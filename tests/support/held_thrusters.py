"""Thrusters of a hull that is too heavy to be moved, stepped by MuJoCo alone: the plant's own,
under a set motion.
"""

import mujoco
import numpy as np

from uuv.models.water import thrusters
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

HEAVY = 1e15  # [kg, kg m^2]


class HeldThrusters:
    """Thrusters by their rows (m, ...) and their wrench columns (6, m) on the hull."""

    def __init__(self, table: Array, wrench: Array, timestep: float) -> None:
        spec = mujoco.MjSpec()
        spec.option.timestep = timestep
        spec.option.gravity = np.zeros(3)
        body = spec.worldbody.add_body(
            name="hull", mass=HEAVY, inertia=[HEAVY] * 3, explicitinertial=True
        )
        body.add_freejoint()

        # A thruster stands anywhere on its line of action.
        for k, (row, column) in enumerate(zip(table, wrench.T, strict=True)):
            axis = column[:3]
            moment = column[3:] - row[thrusters.TORQUE] * column[:3]
            body.add_site(name=f"{k}", pos=np.cross(axis, moment))
            motor = spec.add_actuator(name=f"{k}", target=f"{k}", trntype=mujoco.mjtTrn.mjTRN_SITE)
            motor.gear = [*axis, 0.0, 0.0, 0.0]
        thrusters.attach(spec, {f"{k}": thrusters.unpack(row) for k, row in enumerate(table)})
        self.model = hydrodynamics.compile(spec)
        self.data = mujoco.MjData(self.model)

    def step(
        self, command: Array, R_WB: Array, v_WB_W: Array, w_WB_B: Array, current_W: Array
    ) -> None:
        """One step of MuJoCo, in which the hull moves so."""
        self.data.qpos[:3] = 0.0
        self.data.qpos[3:] = quat_wxyz_from_rotation(R_WB)
        self.data.qvel[:3], self.data.qvel[3:] = v_WB_W, w_WB_B
        self.model.opt.wind, self.data.ctrl[:] = current_W, command
        mujoco.mj_step(self.model, self.data)

    @property
    def speed(self) -> Array:
        """Normalised speeds (m,) of the propellers."""
        return np.array(self.data.act.reshape(-1, thrusters.ACTIVATIONS)[:, thrusters.SPEED])

    @property
    def thrust(self) -> Array:
        """Thrusts (m,) [N] in the last step."""
        return np.array(self.data.actuator_force)
