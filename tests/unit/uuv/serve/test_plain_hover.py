"""A plain hover controller at 100 Hz, built in, over a socket and behind a link that is late."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from experiments.runtime.udp_links import Link, behind
from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.models.water.thruster_curves import command_for
from uuv.models.water.thrusters import curves
from uuv.runner import run
from uuv.serve import client, datagrams
from uuv.serve.client import Client
from uuv.serve.own_controller import estimate_of, reference_of
from uuv.serve.remote_controller import UdpController
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import log_so3

PERIOD = 0.01  # [s]
SECONDS = 8.0


class PlainHover:
    """PID on the pose of the hull, PD on the joints, with thrusts by the pseudo-inverse."""

    period = PERIOD

    def __init__(self, vehicle):
        self.inverse = np.linalg.pinv(np.array(vehicle.thruster_wrench))
        self.curves = curves(vehicle.thruster_table)
        self.state = self.init(None)  # of the client

    def init(self, estimate):
        del estimate
        return np.zeros(6)  # integral of the errors

    def step(self, state, estimate, reference):
        R_BW = estimate.X_WB[:3, :3].T
        off_B = R_BW @ (reference.X_WB[:3, 3] - estimate.X_WB[:3, 3])
        turn_B = log_so3(R_BW @ reference.X_WB[:3, :3])
        state += PERIOD * np.concatenate([off_B, turn_B])  # in place: the loop has bound it
        force = 600.0 * off_B + 400.0 * state[:3] - 500.0 * estimate.v_WB_B
        moment = 300.0 * turn_B + 200.0 * state[3:] - 150.0 * estimate.w_WB_B
        thrusts = self.inverse @ np.concatenate([force, moment])
        pairs = zip(self.curves, thrusts, strict=True)
        return state, Command(
            time=estimate.time,
            joint_torque=200.0 * (reference.q - estimate.q) - 20.0 * estimate.qd,
            thrusters=np.clip([command_for(curve, thrust) for curve, thrust in pairs], -1.0, 1.0),
            scan=reference.scan,
        )

    def answer(self, frame):
        """As a client."""
        if frame.flag(client.START):
            self.state = self.init(None)
            return {"joint_torque": [0.0] * frame.joints, "thrusters": [0.0] * frame.thrusters}
        self.state, command = self.step(self.state, estimate_of(frame), reference_of(frame))
        return {"joint_torque": command.joint_torque, "thrusters": command.thrusters}


def hovered(connected):
    """RMS distance [m] of the hull from its set position in the second half, and the digest."""
    assembly = assemble(jobs.open_water(quick=True))
    hover = PlainHover(assembly.own.vehicle)
    recording = run(connected(assembly, hover), longest=SECONDS).recording
    off = recording["p_WB"].value - recording["p_WB_reference"].value
    off = off[len(off) // 2 :]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1)))), recording.digest()


def built_in(assembly, hover):
    parts = replace(assembly.parts, controller=SafetyWrapper(hover, assembly.own.model))
    return replace(assembly, loop=replace(assembly.loop, parts=parts))


@pytest.fixture(scope="module")
def alone():
    return hovered(built_in)


def test_over_a_socket_in_lockstep_it_is_the_same_to_the_bit(alone):
    with datagrams.listening(0) as endpoint:

        def serve(hover):
            with Client(port=endpoint.port) as vehicle:
                for frame in vehicle:
                    vehicle.send(frame, **hover.answer(frame))

        remotes = []

        def connected(assembly, hover):
            threading.Thread(target=serve, args=(hover,), daemon=True).start()
            remotes.append(UdpController(endpoint, assembly.own.vehicle, period=PERIOD))
            return built_in(assembly, remotes[-1])

        digest = hovered(connected)[1]
        remotes[-1].close()
    assert digest == alone[1]


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_late_it_hovers_as_well_within_a_tenth(alone, delay):
    def connected(assembly, hover):
        def answer(frame):
            return client.answer(frame, **hover.answer(frame))

        return behind(assembly, answer, Link(delay=delay), period=PERIOD)[0]

    rms, digest = hovered(connected)
    print(f"{1e3 * alone[0]:.2f} mm built in, {1e3 * rms:.2f} mm at {1e3 * delay:.0f} ms")
    assert rms == pytest.approx(alone[0], rel=0.1)
    assert (digest == alone[1]) == (delay == 0.0)
