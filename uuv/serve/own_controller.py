"""The project's own controller behind the socket of `uuv serve udp`, in a process of its own.

    uuv serve udp clean-barrel --quick &
    python -m uuv.serve.own_controller clean-barrel

It shows how a measurement's fields become what a controller of the project takes.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.joint_servo import SoftAxis, hull_compensation, servo_feedback
from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.serve import client
from uuv.serve.client import Packet
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array

_STATES = tuple(WorkState)
_WATCHED = 1.0  # [s] from the start, in which the age of the link is learnt
_USUAL = 90.0  # [%] of those ages that are not larger than the link's usual one
_PHASE = 0.5  # [rad] that a late link may take from the force loop


def pose(p: Sequence[float], R: Sequence[float]) -> Array:
    """Pose (4, 4) of a position (3,) [m] and a rotation (9,), row by row."""
    X = np.eye(4)
    X[:3, 3] = p
    X[:3, :3] = np.reshape(R, (3, 3))
    return X


def estimate_of(frame: Packet) -> StateEstimate:
    """The estimate in a measurement."""
    names = (
        *("v_WB_B", "w_WB_B", "a_WB_B", "position_sigma", "q", "qd", "tau"),
        *("object_moved_W", "gyro_off_B", "attitude_off_B"),
    )
    arrays: dict[str, Any] = {name: np.array(getattr(frame, name)) for name in names}

    return StateEstimate(
        time=frame.time,
        X_WB=pose(frame.p_WB, frame.R_WB),
        attitude_sigma=frame.attitude_sigma,
        vision_age=frame.vision_age,
        dvl_age=frame.dvl_age,
        imu_age=frame.imu_age,
        imu_jump_age=frame.imu_jump_age,
        tau_doubt=None if np.isnan(frame.tau_doubt).any() else np.array(frame.tau_doubt),
        **arrays,
    )


def reference_of(frame: Packet) -> Reference:
    """The set points in a measurement."""
    follows = np.isfinite(frame.p_WG_set).all()

    lost = tuple(i for i in range(frame.thrusters) if frame.lost >> i & 1)
    return Reference(
        time=frame.set_time,
        state=_STATES[int(frame.state)],
        X_WB=pose(frame.p_WB_set, frame.R_WB_set),
        v_WB_W=np.array(frame.v_WB_set),
        w_WB_W=np.array(frame.w_WB_set),
        X_WG=pose(frame.p_WG_set, frame.R_WG_set) if follows else None,
        v_WG_W=np.array(frame.v_WG_set),
        w_WG_W=np.array(frame.w_WG_set),
        q=np.array(frame.q_set),
        qd=np.array(frame.qd_set),
        set_force=frame.set_force,
        path_s=frame.path_s,
        force_control=frame.flag(client.FORCE_CONTROL),
        tare=frame.flag(client.TARE),
        scan=frame.flag(client.SCAN),
        compliant=frame.flag(client.COMPLIANT),
        standing=frame.flag(client.STANDING),
        lost_thrusters=lost,
        lost_thrust=tuple(frame.lost_thrust[i] for i in lost),
    )


class OwnController:
    """The controller of a job, which answers measurements.

    On a link that is late it lets the vehicle's drives carry its commands on, with its own servo's
    gains, and slows its force loop down to what the link allows.
    """

    def __init__(self, job: str) -> None:
        """Set up the controller of a job by name.

        Raises:
            ConfigurationError: There is no such job.
        """
        assembly = assemble(jobs.named(job)())
        wrapped: Any = assembly.parts.controller
        self._controller = wrapped.controller  # the safety wrapper runs in the simulation
        self._arm = ArmDynamics(assembly.own.model)
        self._state: Any = None
        self._reference: Reference | None = None
        self._began = 0.0  # [s] simulated
        self._ages: list[float] = []  # [s] of the link, at the start

    def answer(self, frame: Packet) -> dict[str, Any]:
        """Quantities of the command for a measurement."""
        estimate = estimate_of(frame)
        if self._reference is None or frame.flag(client.FRESH):
            self._reference = reference_of(frame)
        if self._state is None or frame.flag(client.START):
            self._state = self._controller.init(estimate)
            self._began = frame.time
            self._ages = []
        if frame.flag(client.START):
            return {"joint_torque": [0.0] * frame.joints, "thrusters": [0.0] * frame.thrusters}

        # Friction of the gears is what the drives gave less what the sensors measured.
        contact_work = isinstance(self._controller, WorkController)
        if contact_work:
            self._state.command.tau[:] = frame.applied_torque
            self._heed(frame, estimate)

        self._state, command = self._controller.step(self._state, estimate, self._reference)
        # What it believes goes along: contact and thruster faults are judged by it.
        load = command.hull_load
        further: dict[str, Any] = (
            {} if load is None else {"arm_wrench_B": load.arm_wrench_B, "current_W": load.current_W}
        )
        if contact_work and frame.link_age > 0.0:
            further |= self._feedback(estimate.q)
        return {
            "joint_torque": command.joint_torque,
            "thrusters": command.thrusters,
            "force_W": command.contact.force_W,
            "normal": float(command.contact.normal),
            "sigma_G": command.contact.sigma_G,
            **further,
        }

    def _heed(self, frame: Packet, estimate: StateEstimate) -> None:
        """Learn how late the link is, and set the force loop accordingly, before the work."""
        if frame.time - self._began <= _WATCHED:
            if frame.link_age < math.inf:
                self._ages.append(frame.link_age)
            return
        if not self._ages:
            return

        # A hiccup is not the link's usual age.
        age = float(np.percentile(self._ages, _USUAL))
        self._ages = []
        if age > 0.0:
            tool = self._controller.tool
            tool.force_law = slowed(tool.force_law, age)
            self._state = self._controller.init(estimate)

    def _feedback(self, q: Array) -> dict[str, Array]:
        """How the torques are to follow joints (n,) [rad] and hull, if the command is late."""
        state = self._state
        motion = state.tool.motion
        sensed = state.contact.record.sensed
        soft = SoftAxis(motion.yielding, float(state.softness[0]))
        stiffness, damping = servo_feedback(self._arm, self._controller.servo.drives, q, soft)
        friction = state.contact.record.friction
        gains = {
            "stiffness": stiffness.ravel(),
            "damping": damping.ravel(),
            "gear_friction": friction.copy(),
        }

        # A tool that follows a pose in the world does not move with the hull.
        if motion.holding[0] or not self._controller.tool.drift.follows_hull:
            return gains
        return gains | {"compensation": hull_compensation(sensed.X_BG, sensed.J_B).ravel()}


def slowed(law: Any, age: float) -> Any:
    """Force law for forces that are felt `age` [s] late; as it is if it has no bandwidth."""
    if not isinstance(law, ForceDisplacement):
        return law
    bandwidth = min(law.bandwidth, _PHASE / age)
    return replace(law, bandwidth=bandwidth, response=law.response + age)


def main(job: str, port: int = client.PORT) -> None:
    """Control the vehicle of a job until its run ends."""
    controller = OwnController(job)
    with client.Client(port=port) as vehicle:
        for frame in vehicle:
            vehicle.send(frame, **controller.answer(frame))


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
