"""Clients of the UDP door that hold the joints, and a run that is served to them."""

import math
import random
import threading
from dataclasses import replace

from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.runner import run
from uuv.serve import client
from uuv.serve.client import Client
from uuv.serve.remote_controller import UdpController


class Holding(threading.Thread):
    """A client that holds the joints where they began, over a link that loses and doubles.

    It forgets none of what it was asked: its command depends on the measurement alone.
    """

    def __init__(self, port, *, lost=0.0, ends=math.inf):
        super().__init__(daemon=True)
        self.port, self.lost, self.ends = port, lost, ends
        self.frames = 0

    def run(self):
        chance = random.Random(1)
        with Client(port=self.port, patience=10.0) as vehicle:
            vars(vehicle)["_socket"] = Lossy(vehicle._socket, chance, self.lost)
            for frame in vehicle:
                if frame.time > self.ends:
                    return
                self.frames += 1
                errors = zip(frame.q_set, frame.q, frame.qd, strict=True)
                torque = [200.0 * (q_set - q) - 20.0 * qd for q_set, q, qd in errors]
                vehicle.send(frame, joint_torque=torque, thrusters=[0.0] * frame.thrusters)


class Lossy:
    """A socket that loses commands, and sends some twice."""

    def __init__(self, link, chance, lost):
        self._link, self._chance, self._lost = link, chance, lost

    def send(self, data):
        if data[:4] == client.COMMANDED:
            if self._chance.random() < self._lost:
                return len(data)
            if self._chance.random() < self._lost:
                self._link.send(data)
        return self._link.send(data)

    def __getattr__(self, name):
        return getattr(self._link, name)


def served(endpoint, *, pace=None, longest=0.4, scenario=None, period=0.01, observers=()):
    """A run, of open water by default, with its controller behind the socket; and that one."""
    assembly = assemble(scenario or jobs.open_water(quick=True))
    remote = UdpController(endpoint, assembly.own.vehicle, period=period, pace=pace)
    guarded = SafetyWrapper(remote, assembly.own.model)
    parts = replace(assembly.parts, controller=guarded)
    outcome = run(
        replace(assembly, loop=replace(assembly.loop, parts=parts)),
        longest=longest,
        observers=observers,
    )
    remote.close()
    return outcome, remote
