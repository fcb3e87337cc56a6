"""Clients of the UDP door as they should not be, and as they come and go."""

import math
import socket
import threading
import time
from dataclasses import replace

import pytest

from udp_clients import Holding, served
from uuv.cli.live import serve
from uuv.pace import WallClock
from uuv.serve import client, datagrams
from uuv.serve.client import Client, PacketError, answer, pack
from uuv.serve.remote_controller import LARGEST
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind


class Answering(threading.Thread):
    """A client that answers each measurement by zeros, changed by `change(frame, command)`."""

    def __init__(self, port, change=lambda _, command: command, *, after=0.0, ends=math.inf):
        super().__init__(daemon=True)
        self.port, self.change, self.after, self.ends = port, change, after, ends
        self.frames = 0

    def run(self):
        time.sleep(self.after)
        with Client(port=self.port) as vehicle:
            for frame in vehicle:
                if frame.time > self.ends:
                    return
                self.frames += 1
                still = {"joint_torque": [0.0] * frame.joints, "thrusters": [0.0] * frame.thrusters}
                command = client.unpack(answer(frame, **still))
                vehicle._transmit(pack(self.change(frame, command)))


def changed(**quantities):
    """Change of a command from the second frame on."""

    def change(frame, command):
        if frame.flag(client.START):
            return command
        return replace(command, values=command.values | quantities)

    return change


def test_a_client_that_comes_late_is_waited_for():
    with datagrams.listening(0) as endpoint:
        Answering(endpoint.port, after=0.5).start()
        _, remote = served(endpoint, pace=WallClock(0.5), longest=0.05)
    assert remote.traffic.silent == 0
    assert remote.traffic.taken >= 2


class Hiccup:
    """Observer that holds the simulation up once."""

    slow_ticks = (10,)

    def __init__(self):
        self.waited = False

    def observe(self, moment):
        if moment.truth.time > 0.1 and not self.waited:
            self.waited = True
            time.sleep(1.0)


def test_a_simulation_that_is_behind_still_waits_for_the_client():
    """Else it would make up for its second by ticks without commands: ten of 10 ms."""
    with datagrams.listening(0) as endpoint:
        Answering(endpoint.port).start()
        pace = WallClock(0.1)
        _, remote = served(endpoint, pace=pace, longest=0.3, observers=(Hiccup(),))
    assert pace.report()["late_max_s"] > 0.8
    assert remote.traffic.silent == 0
    assert remote.traffic.oldest_s < 0.045


def test_in_lockstep_a_client_that_comes_again_goes_on():
    """It has another port; after a second without the first one it is heard."""
    with datagrams.listening(0) as endpoint:
        first = Holding(endpoint.port, ends=0.1)
        first.start()

        def again():
            first.join()
            Holding(endpoint.port).start()

        threading.Thread(target=again, daemon=True).start()
        _, remote = served(endpoint, longest=0.2)
    assert remote.traffic.silent == 0
    assert remote.traffic.reason == "a second client, while the first one answers"


def test_of_two_clients_the_first_is_answered():
    with datagrams.listening(0) as endpoint:
        first = Answering(endpoint.port)
        first.start()
        second = Answering(endpoint.port, after=0.2)
        second.start()
        _, remote = served(endpoint, pace=WallClock(0.2), longest=0.1)
    assert remote.traffic.taken >= 5
    assert second.frames == 0
    assert "last refused: a second client" in remote.traffic.summary()


@pytest.mark.parametrize(
    ("quantities", "reason"),
    [
        ({"joint_torque": (1e300,) * 6}, "joint_torque: must be within"),
        ({"stiffness": (-1e9,) * 36}, "stiffness: must be within"),
        ({"normal": 2.0 * LARGEST}, "normal: must be within"),
        ({"joint_torque": (math.nan,) * 6}, ""),
    ],
)
def test_a_command_that_nobody_can_mean_leads_to_the_departure(quantities, reason):
    with datagrams.listening(0) as endpoint:
        Answering(endpoint.port, changed(**quantities)).start()
        outcome, remote = served(endpoint, longest=0.2)
    assert remote.traffic.reason.startswith(reason)
    command = outcome.result.last.command
    assert [fault.kind for fault in command.faults] == [FaultKind.CONTROLLER]


def test_torques_beyond_the_drives_are_cut_to_their_limits():
    sent = []

    def note(frame, command):
        if not frame.flag(client.START):
            sent.append(frame.applied_torque)
        return changed(joint_torque=(1e5, -1e5, 0.0, 0.0, 0.0, 0.0))(frame, command)

    with datagrams.listening(0) as endpoint:
        Answering(endpoint.port, note).start()
        outcome, _ = served(endpoint, longest=0.05)
    limits = outcome.assembly.own.vehicle.torque_limits
    assert sent[-1][:3] == pytest.approx([limits[0], -limits[1], 0.0])


def test_an_unknown_quantity_is_refused_where_it_is_sent():
    frame = client.Packet(client.MEASURED, 1, 1, 0, 0, 0, 0.0, {})
    still = {"joint_torque": [0.0], "thrusters": [0.0]}
    with pytest.raises(PacketError, match=r"force_w: is no quantity of a command .joint_torque, "):
        answer(frame, force_w=[0.0, 0.0, 0.0], **still)
    with pytest.raises(PacketError, match="stiffness: must have 1 numbers, got 4"):
        answer(frame, stiffness=[0.0] * 4, **still)


def test_a_client_of_another_version_is_named_and_the_right_one_served(tmp_path, capfd):
    with datagrams.listening(0) as endpoint:
        port = endpoint.port
    old = client.HEADER.pack(client.ENDED, 1, 0, 0, 0, 0, 0, 0.0)

    def come():
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.connect(("127.0.0.1", port))
            heard = 0
            while heard < 6:  # refused as long as nobody listens
                try:
                    stranger.send((old, b"hello")[heard % 2])
                    heard += 1
                except ConnectionRefusedError:
                    heard = 0
                time.sleep(0.05)
        Holding(port).start()

    threading.Thread(target=come, daemon=True).start()
    words = ["open-water", "--no-record", "--rate", "100", "--set", "task.seconds=1"]
    places = ["--longest", "1", "--port", str(port), "--out", str(tmp_path / "run")]
    with pytest.raises(ConfigurationError, match="did not begin within 1 s"):
        serve.main("serve udp", [*words, *places])
    lines = capfd.readouterr().out.splitlines()
    assert lines.count("refused: the version must be 2, got 1") == 1
    assert lines.count("refused: a frame has at least 28 bytes, got 5") == 1
