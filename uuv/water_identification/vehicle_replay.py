"""A vehicle that replays a log in compiled code: thrusters follow its commands, joints its angles.

The joints are driven to exact accelerations: each gets an additional inertia, far larger than all
others, and the corresponding torque. The arm's motion in the log then acts on the hull, and no
servo limits the time step.
"""

import copy
import ctypes
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.calib.water.parameters import VehicleWater
from uuv.models.hydrodynamics import LAYOUT, world_row
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.models.water.mujoco_library import library
from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.native_memory import call_physics
from uuv.water_identification.replayed_parts import pushed_parts

LONGEST_STEP, SHORTEST_STEP = 0.05, 0.005  # [s] step of the replay
_USUAL_SPEED = 1.0  # [m/s, rad/s] speeds for whose drag the step is chosen
_ROTOR = 1e8  # [kg m^2] additional inertia of the driven joints; MuJoCo accepts controls up to 1e10
_WILD = 30.0  # [m/s, rad/s] speed beyond which a window is aborted
_FINE = 0.01  # [s] grid for the lag of the propellers
PARTS = 8  # number of parts of a step; the thrusts at their centres are averaged
STATE = 13  # state of the hull: p_WB, quat_WB_wxyz, v_WB_W, w_WB_B


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Script:
    """Inputs of the vehicle in windows of time, with one row for each step, window after window.

    A window of k steps has k + 1 rows.
    """

    first: np.ndarray  # (W,) row at which each window begins
    steps: np.ndarray  # (W,) number of steps of each window
    speed: Array  # (R, PARTS, m) propeller speeds during each step
    thrust: Array  # (R, m) [N] thrusts in place of the speeds; NaN where the speed counts
    q: Array  # (W, n) [rad] joint angles at the start
    qd: Array  # (W, n) [rad/s]
    qdd: Array  # (R, n) [rad/s^2] during each step

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.speed)


class ReplayVehicle:
    """One vehicle, compiled for replay. Only one thread may use it at a time (see `copy`)."""

    def __init__(self, spec: mujoco.MjSpec) -> None:
        """Compile `spec` for replay.

        Raises:
            ConfigurationError: `spec` is not a vehicle of the contract, or has no hydrodynamics.
            HydrodynamicsError: As for `uuv.sim.hydrodynamics.compile`.
        """
        original = hydrodynamics.compile(spec.copy())
        self.vehicle = vehicle = Vehicle.of(original)
        if not hydrodynamics.carries_hydrodynamics(original):
            raise ConfigurationError(
                "the vehicle must have hydrodynamics as the prior; attach them to its bodies"
            )

        pushed = pushed_parts(original, vehicle)
        self.names = tuple(pushed.values())
        self.joints = vehicle.joint_names
        self.water = VehicleWater.of(original, gains=self.names)
        self.model = _compiled(spec, vehicle, [original.actuator(i).name for i in pushed])

        water = world_row(original)
        rate = float(water[LAYOUT.drag_rate] + _USUAL_SPEED * water[LAYOUT.drag_rate + 1])
        self.timestep = float(np.clip(1.0 / max(rate, 1e-3), SHORTEST_STEP, LONGEST_STEP))
        self.model.opt.timestep = self.timestep

        # the callback's warnings do not apply to RK4, and W is the frame of the log
        row = world_row(self.model)
        row[LAYOUT.drag_rate : LAYOUT.drag_rate + 2] = 0.0
        row[LAYOUT.ceiling] = 1e9

        # Thrusters with a table follow their curves; other actuators give the logged force.
        actuators = vehicle.thruster_actuators
        width = vehicle.thruster_table.shape[1] if len(actuators) else 0
        rows = {
            int(a): row
            for a, row in zip(vehicle.thruster_actuators, vehicle.thruster_table, strict=True)
        }
        self.has_curve = np.array([i in rows for i in pushed], dtype=np.bool_)
        table = np.array([rows.get(i, np.zeros(width)) for i in pushed]).reshape(len(pushed), width)

        self.lag = table[:, TIME_CONSTANT] if width else np.zeros(len(pushed))
        self.slew = table[:, SLEW_RATE] if width else np.zeros(len(pushed))
        loss = table[:, INFLOW_LOSS] if width else np.zeros(len(pushed))

        tables = curves(vehicle.thruster_table)
        curve = np.zeros((len(pushed), max(tables.shape[1], 1)))
        if len(actuators):
            curve[self.has_curve] = tables

        advance = np.zeros((6, len(pushed)))
        if width:
            advance[:, self.has_curve] = inflow_levers(
                vehicle.thruster_table, vehicle.thruster_wrench
            )
        self._thrusters = curve, loss, advance
        self.curve = curve  # (m, ...) static curves; zero if `has_curve` is False

        self.pushes = np.array(
            [self.model.actuator(original.actuator(i).name).id for i in pushed], dtype=np.int64
        )
        self.wrench = self._wrenches()
        self._bind()

    def _wrenches(self) -> Array:
        """Wrenches (6, m) on the hull at its origin per newton of each thruster, hull axes."""
        data = mujoco.MjData(self.model)
        wrenches = np.zeros((6, len(self.pushes)))
        first = self.vehicle.hull_dof

        # Forces on a free joint are in world axes: the hull's are parallel to them.
        at = self.vehicle.hull_qpos
        data.qpos[at + 3 : at + 7] = [1.0, 0.0, 0.0, 0.0]

        for k, i in enumerate(self.pushes):
            data.ctrl[:] = 0.0
            data.ctrl[i] = 1.0
            mujoco.mj_forward(self.model, data)
            wrenches[:, k] = data.qfrc_actuator[first : first + 6]
        return wrenches

    def _bind(self) -> None:
        self.data = mujoco.MjData(self.model)
        self._written: Mapping[str, float] | None = None
        self._gains = np.ones(len(self.names))

        driven = [self.model.joint(name) for name in self.joints]
        step = ctypes.cast(library().mj_step, ctypes.c_void_p).value or 0
        self._places = np.array([step, self.model._address, self.data._address], dtype=np.int64)
        self._joints = (
            np.array([int(joint.qposadr[0]) for joint in driven], dtype=np.int64),
            np.array([int(joint.dofadr[0]) for joint in driven], dtype=np.int64),
            np.array(
                [self.model.actuator(f"drive {name}").id for name in self.joints], dtype=np.int64
            ),
        )

    def copy(self) -> "ReplayVehicle":
        """A copy with its own memory, for another thread."""
        twin = object.__new__(ReplayVehicle)
        twin.__dict__.update(self.__dict__)
        twin.model = copy.deepcopy(self.model)
        twin._bind()
        return twin

    def followed(
        self, command: Array, state: tuple[Array, Array], dt: float, count: int
    ) -> tuple[Array, tuple[Array, Array]]:
        """Propeller speeds (count, PARTS, m) in steps with a constant command, and the state before
        the last.
        """
        passed, speed = state

        decay = np.where(self.lag > 0.0, np.exp(-dt / np.where(self.lag > 0.0, self.lag, 1.0)), 0.0)
        most = np.where(self.slew > 0.0, self.slew * dt, np.inf)
        shares = decay[:, None] ** ((np.arange(PARTS) + 0.5) / PARTS)

        speeds = np.empty((count, PARTS, len(command)))
        after = state
        for k in range(count):
            after = passed, speed
            passed = passed + np.clip(command - passed, -most, most)
            speeds[k] = passed + (speed - passed) * shares.T
            speed = passed + (speed - passed) * decay
        return speeds, after

    def speeds(self, time: Array, commands: Array, at: Array) -> Array:
        """Propeller speeds (k, PARTS, m) in steps that begin at times `at` (k,).

        Commands (N, m) are held from their times (N,) on.
        """
        count = (
            int(np.ceil((float(at.max(initial=time[0])) + self.timestep - float(time[0])) / _FINE))
            + 2
        )

        grid = float(time[0]) + _FINE * np.arange(count)
        held = commands[np.clip(np.searchsorted(time, grid + 1e-9) - 1, 0, len(time) - 1)]
        state = (held[0], held[0])
        speeds = np.empty((count, held.shape[1]))
        for k, command in enumerate(held):
            speeds[k] = state[1]
            _, state = self.followed(command, state, _FINE, 2)

        middles = at[:, None] + self.timestep * (np.arange(PARTS) + 0.5) / PARTS
        columns = [
            np.interp(middles.ravel(), grid, column).reshape(middles.shape) for column in speeds.T
        ]
        return np.stack(columns, axis=-1) if columns else np.zeros((*middles.shape, 0))

    def write(self, values: Mapping[str, float]) -> None:
        """Write a value for each parameter of `water` into the model."""
        if values is not self._written:
            self.water.write(self.model, values)
            self._gains = self.water.gains(values)
            self._written = values

    def run(
        self, values: Mapping[str, float], script: Script, starts: Array, currents: Array
    ) -> Array:
        """Simulate all windows.

        Args:
            values: A value for each parameter of `water`.
            script: Inputs of the vehicle.
            starts: (W, 13) state of the hull at the start of each window.
            currents: (R, 3) [m/s] Current at each row, world axes, with linear interpolation.

        Returns:
            States (R, 13) of the hull.
        """
        self.write(values)

        rows = np.zeros((script.rows, STATE))
        mujoco.mj_resetData(self.model, self.data)

        addresses = self.vehicle.hull_qpos, self.vehicle.hull_dof
        flow = world_row(self.model)[LAYOUT.current_acceleration :][:3]
        views = self.data.qpos, self.data.qvel, self.data.ctrl, self.model.opt.wind, flow

        # Numba takes arrays and tuples of arrays.
        _replay(
            self._places,
            views,
            addresses,
            self._joints,
            self.pushes,
            self._thrusters,
            self._gains,
            (
                script.first,
                script.steps,
                script.speed,
                script.thrust,
                script.q,
                script.qd,
                script.qdd,
            ),
            starts,
            currents,
            float(self.model.opt.timestep),
            rows,
        )
        return rows


@kernel(nogil=True)
def _replay(
    places, views, addresses, joints, pushes, thrusters, gains, script, starts, currents, dt, rows
):
    """Step all windows, and write the hull's state before each step and at the end of a window to
    `rows`.
    """
    qpos, qvel, ctrl, wind, flow = views
    at_q, at_v = addresses
    joint_q, joint_v, joint_ctrl = joints
    curve, loss, advance = thrusters
    first, steps, speed, thrust, q, qd, qdd = script
    nu_r, before, R = np.empty(6), np.empty(6), np.empty((3, 3))

    for w in range(first.shape[0]):
        for i in range(7):
            qpos[at_q + i] = starts[w, i]
        for i in range(6):
            qvel[at_v + i] = before[i] = starts[w, 7 + i]
        for j in range(joint_q.shape[0]):
            qpos[joint_q[j]], qvel[joint_v[j]] = q[w, j], qd[w, j]
        for k in range(steps[w] + 1):
            row = first[w] + k
            for i in range(7):
                rows[row, i] = qpos[at_q + i]
            for i in range(6):
                rows[row, 7 + i] = qvel[at_v + i]
                # Stop before the values that make MuJoCo warn and reset.
                if not abs(qvel[at_v + i]) < _WILD:
                    rows[first[w] : first[w] + steps[w] + 1] = np.nan
                    k = steps[w]
            if k == steps[w]:
                break

            # Rotation matrix of the hull.
            a, b, c, d = qpos[at_q + 3], qpos[at_q + 4], qpos[at_q + 5], qpos[at_q + 6]
            R[0, 0], R[0, 1], R[0, 2] = (
                1.0 - 2.0 * (c * c + d * d),
                2.0 * (b * c - a * d),
                2.0 * (b * d + a * c),
            )
            R[1, 0], R[1, 1], R[1, 2] = (
                2.0 * (b * c + a * d),
                1.0 - 2.0 * (b * b + d * d),
                2.0 * (c * d - a * b),
            )
            R[2, 0], R[2, 1], R[2, 2] = (
                2.0 * (b * d - a * c),
                2.0 * (c * d + a * b),
                1.0 - 2.0 * (b * b + c * c),
            )
            # Inflow of the propellers in the middle of the step; the velocity is extrapolated from
            # the step before.
            for i in range(6):
                nu_r[i] = 0.0 if i < 3 else 1.5 * qvel[at_v + i] - 0.5 * before[i]
            for j in range(3):
                flow[j] = (currents[row + 1, j] - currents[row, j]) / dt
                # in the middle of the step
                wind[j] = 0.5 * (currents[row + 1, j] + currents[row, j])
                through = 1.5 * qvel[at_v + j] - 0.5 * before[j] - wind[j]
                for i in range(3):
                    nu_r[i] += R[j, i] * through
            for i in range(6):
                before[i] = qvel[at_v + i]

            # Force of each actuator: logged, or from its curve with the inflow.
            for i in range(pushes.shape[0]):
                force = thrust[row, i]
                if np.isnan(force):
                    inflow = 0.0
                    for j in range(6):
                        inflow += advance[j, i] * nu_r[j]
                    force = 0.0  # mean over the step, since the curve has kinks
                    for part in range(speed.shape[1]):
                        force += (
                            thrust_in_flow(curve[i], loss[i], inflow, speed[row, part, i])
                            / speed.shape[1]
                        )
                ctrl[pushes[i]] = gains[i] * force

            # Joints: the torque for the logged acceleration.
            for j in range(joint_q.shape[0]):
                ctrl[joint_ctrl[j]] = _ROTOR * qdd[row, j]

            call_physics(places[0], places[1], places[2])


def _compiled(spec: mujoco.MjSpec, vehicle: Vehicle, pushing: list[str]) -> mujoco.MjModel:
    """The model with driven joints, with passive joints locked, and without contacts."""
    spec = spec.copy()

    for group in (
        spec.sensors,
        spec.equalities,
        spec.tendons,
        spec.keys,
        spec.excludes,
        spec.pairs,
    ):
        for element in list(group):
            spec.delete(element)

    for actuator in list(spec.actuators):
        if actuator.name in pushing:
            thrusters.detach(actuator)
        else:
            spec.delete(actuator)

    home = dict(zip(vehicle.joint_names, vehicle.q_home, strict=True))
    for joint in list(spec.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE:
            continue
        if joint.name not in home:
            spec.delete(joint)
            continue

        joint.damping, joint.stiffness, joint.armature = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], _ROTOR
        joint.frictionloss, joint.limited = 0.0, mujoco.mjtLimited.mjLIMITED_FALSE
        actuator = spec.add_actuator(
            name=f"drive {joint.name}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint.name
        )
        actuator.gear = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]

    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT) | int(
        mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    )

    return hydrodynamics.compile(spec)
