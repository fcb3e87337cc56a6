"""Frames of the UDP door, its exchange with lossy clients, and the pace of a run."""

import math
import socket
import threading
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from udp_clients import Holding, served
from uuv import jobs
from uuv.assembly import assemble
from uuv.cli.live import serve
from uuv.pace import WallClock
from uuv.runner import run
from uuv.serve import client, datagrams, own_controller
from uuv.serve.client import Client, Packet, PacketError, pack, unpack
from uuv.serve.remote_controller import UdpController
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind, WorkState


def drawn(kind, rng, joints=6, thrusters=8):
    widths = {"n": joints, "m": thrusters, "nn": joints**2, "n6": 6 * joints}
    fields = client.MEASUREMENT if kind == client.MEASURED else client.COMMAND
    values = {}
    for name, size in fields.items():
        width = size if isinstance(size, int) else widths[size]
        numbers = tuple(rng.normal(size=width).tolist())
        values[name] = numbers[0] if size == 1 else numbers
    return Packet(kind, joints, thrusters, int(rng.integers(2**32)), 37, 5, 1.25, values)


@pytest.mark.parametrize("kind", [client.MEASURED, client.COMMANDED])
@pytest.mark.parametrize("sizes", [(6, 6), (0, 1), (14, 8)])
def test_a_frame_comes_back_to_the_bit(kind, sizes):
    frame = drawn(kind, np.random.default_rng(3), *sizes)
    data = pack(frame)
    assert unpack(data) == frame
    assert len(data) <= client.LARGEST


def test_the_port_is_printed_also_where_the_output_is_json(verb):
    ran = verb("serve", "udp", "clean-barrel", "--port", 0, "--rate", 1, "--json")
    assert ran.returncode == 2
    ready, refused = ran.stderr.strip().splitlines()
    assert ready.startswith("clean_barrel on UDP port ")
    assert refused.startswith("error: rate [Hz]: must be 100 to 500")
    assert not ran.stdout


def test_fields_are_read_by_their_names():
    frame = drawn(client.MEASURED, np.random.default_rng(4))
    assert unpack(pack(frame)).q == frame.values["q"]
    with pytest.raises(AttributeError, match="speed"):
        _ = frame.speed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:10], "at least"),
        (lambda data: data[:-1], "6 joints and 8 thrusters take"),
        (lambda data: data + b"0", "6 joints and 8 thrusters take"),
        (lambda data: b"XXXX" + data[4:], "begins with UUVM"),
        (lambda data: data[:4] + b"\x01\x00" + data[6:], "the version must be 2, got 1"),
    ],
)
def test_what_is_no_frame_is_refused(change, message):
    data = pack(drawn(client.COMMANDED, np.random.default_rng(5)))
    with pytest.raises(PacketError, match=message):
        unpack(change(data))


def test_a_command_of_the_wrong_size_is_refused_before_it_is_sent():
    frame = drawn(client.COMMANDED, np.random.default_rng(6))
    short = replace(frame, values={**frame.values, "thrusters": (0.0,)})
    with pytest.raises(PacketError, match="thrusters: must have 8 numbers, got 1"):
        pack(short)
    less = {name: value for name, value in frame.values.items() if name != "normal"}
    with pytest.raises(PacketError, match="normal: is missing"):
        pack(replace(frame, values=less))


def test_lockstep_is_the_same_over_a_link_that_loses_and_doubles():
    digests = []
    for lost in (0.0, 0.1):
        with datagrams.listening(0) as endpoint:
            holding = Holding(endpoint.port, lost=lost)
            holding.start()
            outcome, remote = served(endpoint)
        digests.append(outcome.recording.digest())
        assert remote.traffic.silent == 0
    assert remote.traffic.again > 0
    assert remote.traffic.stale > 0
    assert digests[0] == digests[1]


def test_a_client_that_goes_silent_leads_to_the_safety_wrappers_departure(monkeypatch):
    monkeypatch.setattr("uuv.serve.remote_controller.PATIENCE", 0.3)
    with datagrams.listening(0) as endpoint:
        holding = Holding(endpoint.port, ends=0.2)
        holding.start()
        outcome, remote = served(endpoint, longest=1.0)
    assert remote.traffic.silent == 1  # the wrapper asks no more after the first
    command = outcome.result.last.command
    assert [fault.kind for fault in command.faults] == [FaultKind.CONTROLLER]
    assert 0.2 < command.faults[0].time < 0.3
    assert np.isfinite(command.joint_torque).all()


def test_the_projects_own_controller_gives_the_built_in_trajectory_to_the_bit():
    scenario = jobs.clean_barrel(quick=True)
    built_in = run(assemble(scenario), longest=0.4)
    with datagrams.listening(0) as endpoint:
        arguments = ("clean-barrel", endpoint.port)
        threading.Thread(target=own_controller.main, args=arguments, daemon=True).start()
        outcome, _ = served(endpoint, scenario=scenario, period=0.002)
    assert outcome.recording.digest() == built_in.recording.digest()


def test_with_json_the_counts_of_frames_are_on_the_error_stream(tmp_path, capfd):
    with datagrams.listening(0) as endpoint:
        port = endpoint.port
    holding = Holding(port)
    holding.start()
    options = ["--json", "--no-record", "--rate", "100", "--set", "task.seconds=1"]
    places = ["--longest", "1", "--port", str(port), "--out", str(tmp_path / "run")]
    with pytest.raises(ConfigurationError, match="did not begin within 1 s"):
        serve.main("serve udp", ["open-water", *options, *places])
    printed = capfd.readouterr()
    assert printed.out == ""
    assert f"open_water on UDP port {port} of 127.0.0.1" in printed.err
    assert "frames: 101 sent, 0 again, 101 taken" in printed.err


def test_the_age_of_a_command_is_the_measurements_whatever_the_client_says():
    lies = [math.nan, 1e9]
    original = client.pack

    def lying(frame):
        lie = lies.pop() if frame.kind == client.COMMANDED and lies else frame.time
        return original(replace(frame, time=lie))

    with datagrams.listening(0) as endpoint, pytest.MonkeyPatch.context() as patch:
        patch.setattr(client, "pack", lying)
        Holding(endpoint.port).start()
        _, remote = served(endpoint, longest=0.1)
    assert remote.traffic.silent == 0
    assert remote.traffic.oldest_s == 0.0


def test_a_simulation_that_began_again_without_a_word_is_a_new_run_for_the_client():
    with datagrams.listening(0) as endpoint:
        holding = Holding(endpoint.port)
        holding.start()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(UdpController, "close", lambda _: None)
            _, first = served(endpoint, longest=0.1)
        _, second = served(endpoint, longest=0.1)
    holding.join(10.0)
    assert not holding.is_alive()
    assert first.traffic.taken >= 10
    assert second.traffic.taken >= 10


def test_a_client_gives_up_when_the_simulation_is_gone(monkeypatch):
    monkeypatch.setattr(client, "_GREETING", 0.3)
    with datagrams.listening(0) as endpoint:
        port = endpoint.port
    with Client(port=port) as vehicle, pytest.raises(TimeoutError, match="no frame"):
        next(iter(vehicle))


def test_the_page_has_the_states_as_they_are_numbered():
    page = (Path(__file__).parents[4] / "docs" / "udp.md").read_text(encoding="utf-8")
    listed = ", ".join(f"{number} {state}" for number, state in enumerate(WorkState))
    assert listed in " ".join(page.split())


def test_paced_the_run_goes_on_with_a_command_that_still_holds():
    pace = WallClock(0.5)
    with datagrams.listening(0) as endpoint:
        holding = Holding(endpoint.port, lost=0.3)
        holding.start()
        _, remote = served(endpoint, pace=pace, longest=0.3)
    assert remote.traffic.held > 0
    assert remote.traffic.silent == 0
    assert 0.0 < remote.traffic.oldest_s <= 0.2
    assert len(pace.late) > 20


def test_foreign_datagrams_are_counted_and_change_nothing():
    with datagrams.listening(0) as endpoint:
        holding = Holding(endpoint.port)
        rng = np.random.default_rng(9)

        original = Client.send
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

        def noisy(self, measured, **words):
            other = drawn(client.COMMANDED, rng, joints=3)
            self._socket.send(pack(replace(other, count=measured.count)))
            original(self, measured, **words)
            # The stranger speaks last.
            stranger.sendto(rng.bytes(int(rng.integers(1, 300))), ("127.0.0.1", endpoint.port))

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Client, "send", noisy)
            holding.start()
            outcome, remote = served(endpoint, pace=WallClock(0.2), longest=0.1)
        stranger.close()
    assert remote.traffic.taken >= 6  # of 10: no measurement went to the stranger
    assert remote.traffic.refused >= 10
    assert remote.traffic.silent == 0
    assert np.isfinite(outcome.recording["p_WB"].value).all()


# --- WallClock ---


class Clock:
    """A clock that the test moves."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.mark.parametrize("factor", [0.1, 1.0, 5.0])
def test_a_tick_is_due_by_the_factor(factor):
    clock = Clock()
    pace = WallClock(factor, clock=clock)
    pace.arrive(0.0, WorkState.SETTLE)
    assert pace.due(2.0) == pytest.approx(100.0 + 2.0 / factor)


def test_lateness_is_noted_and_nothing_is_skipped():
    clock = Clock()
    pace = WallClock(1.0, clock=clock)
    for tick, delay in enumerate((0.0, 0.01, 0.09, 0.0)):
        clock.now = 100.0 + 0.01 * tick + delay
        pace.arrive(0.01 * tick, WorkState.WORK)
    assert pace.late == pytest.approx([0.0, 0.01, 0.09, 0.0])
    assert not pace.pauses
    assert pace.due(1.0) == pytest.approx(101.0)  # the clock was not moved for it


def test_a_scan_stops_the_clock():
    clock = Clock()
    pace = WallClock(2.0, clock=clock)
    pace.arrive(0.0, WorkState.SETTLE)
    clock.now += 0.5
    pace.arrive(1.0, WorkState.SCAN)
    clock.now += 20.005
    pace.arrive(1.01, WorkState.SCAN)
    clock.now += 7.005
    pace.arrive(1.02, WorkState.CLOSE_IN)
    assert [length for _, length in pace.pauses] == pytest.approx([20.0, 7.0])
    assert pace.report()["late_max_s"] == pytest.approx(0.0, abs=1e-9)
    assert pace.due(1.02) == pytest.approx(clock.now)


def test_what_a_run_was_late_by_is_no_pause():
    clock = Clock()
    pace = WallClock(1.0, clock=clock)
    pace.arrive(0.0, WorkState.APPROACH)
    clock.now += 0.31
    pace.arrive(0.01, WorkState.APPROACH)
    clock.now += 0.01
    pace.arrive(0.02, WorkState.PRESS)  # another state, and nothing stopped for it
    assert not pace.pauses

    clock.now += 20.01
    pace.arrive(0.03, WorkState.WORK)
    assert [length for _, length in pace.pauses] == pytest.approx([20.0])
    assert pace.late == pytest.approx([0.0, 0.3, 0.3, 0.3])
    assert pace.due(0.03) == pytest.approx(clock.now - 0.3)


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, 1e6])
def test_a_pace_that_cannot_be_kept_is_refused(factor):
    with pytest.raises(ConfigurationError, match="times real time"):
        WallClock(factor)
