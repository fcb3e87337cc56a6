"""The project's own controller behind the socket of `uuv serve udp`, in a process of its own.

    uuv serve udp clean-barrel --quick &
    python -m uuv.serve.own_controller clean-barrel

It shows how a measurement's fields become what a controller of the project takes.
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from uuv import jobs
from uuv.assembly import assemble
from uuv.serve import client
from uuv.serve.client import Packet
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array

_STATES = tuple(WorkState)


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


def main(job: str, port: int = client.PORT) -> None:
    """Control the vehicle of a job until its run ends."""
    wrapped: Any = assemble(jobs.named(job)()).parts.controller
    controller = wrapped.controller  # the safety wrapper itself runs in the simulation
    state: Any = None
    reference: Reference | None = None

    with client.Client(port=port) as vehicle:
        for frame in vehicle:
            estimate = estimate_of(frame)
            if reference is None or frame.flag(client.FRESH):
                reference = reference_of(frame)
            if state is None or frame.flag(client.START):
                state = controller.init(estimate)

            if frame.flag(client.START):
                idle = [0.0] * frame.joints
                vehicle.send(frame, joint_torque=idle, thrusters=[0.0] * frame.thrusters)
                continue

            state, command = controller.step(state, estimate, reference)
            # What it believes goes along: contact and thruster faults are judged by it.
            load = command.hull_load
            loads: dict[str, Any] = (
                {}
                if load is None
                else {"arm_wrench_B": load.arm_wrench_B, "current_W": load.current_W}
            )
            contact = command.contact
            vehicle.send(
                frame,
                joint_torque=command.joint_torque,
                thrusters=command.thrusters,
                force_W=contact.force_W,
                normal=float(contact.normal),
                sigma_G=contact.sigma_G,
                **loads,
            )


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
