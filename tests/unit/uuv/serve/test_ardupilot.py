"""ArduPilot's door: packets, frames, lockstep, and a foreign controller that holds a depth."""

import json
import math
import struct
import threading

import numpy as np
import pytest

from uuv.logs.ardusub_frames import FRAMES, MotorMap
from uuv.serve import datagrams
from uuv.serve.ardupilot import ArduPilotDoor
from uuv.serve.ardupilot_packets import roll_pitch_yaw, servo_packet
from uuv.serve.served_vehicle import DiveSite
from uuv.sim.interfaces.errors import ConfigurationError

RATE = 100  # [Hz]


def packet(count, pulses=(), *, rate=RATE, channels=16):
    values = [int(pulse) for pulse in pulses]
    values += [1500] * (channels - len(values))
    magic = {16: 18458, 32: 29569}[channels]
    return struct.pack(f"<HHI{channels}H", magic, rate, count, *values)


def motion(answer):
    assert answer.startswith(b"\n")
    assert answer.endswith(b"\n")
    return json.loads(answer)


@pytest.fixture(scope="module", params=["vectored", "vectored_6dof"])
def door(request):
    return ArduPilotDoor(request.param, water=DiveSite(depth=3.0))


def begun(door):
    """The door as for a new autopilot."""
    door.reply(packet(0))
    door.reply(packet(5))
    door.reply(packet(0))
    return door


def accelerations(state):
    """Roll right, pitch up, yaw right, up, forward, right: as the body's first motion has it."""
    roll, pitch, yaw = state["imu"]["gyro"]
    north, east, down = state["velocity"]
    return np.array([roll, pitch, yaw, -down, north, east])


@pytest.mark.parametrize("motor", range(8))
def test_each_motor_alone_acts_as_the_frame_says(door, motor):
    frame = "vectored" if len(door.motors.thrusters) == 6 else "vectored_6dof"
    factors = FRAMES[frame]
    motor %= len(factors)

    pulses = [1500] * len(factors)
    pulses[motor] = 1800
    begun(door)
    for count in range(1, 11):
        door.reply(packet(count, pulses))
    state = motion(door.reply(packet(11, pulses)))

    acts = factors[motor] != 0
    assert np.array_equal(np.sign(accelerations(state))[acts], factors[motor][acts])


def test_signs_turn_with_the_direction_of_a_motor():
    frame = "vectored"
    wrench_B = ArduPilotDoor(frame).vehicle.vehicle.thruster_wrench
    plain = MotorMap.of(frame, wrench_B)
    turned = MotorMap.of(frame, wrench_B, directions=[1, 1, -1, 1, 1, 1])

    pulses = np.full(16, 1700.0)
    ratio = turned.commands(pulses) / plain.commands(pulses)
    assert np.array_equal(ratio, [1, 1, -1, 1, 1, 1])


def test_thrusters_are_matched_by_effect_not_by_order():
    wrench_B = ArduPilotDoor("vectored_6dof").vehicle.vehicle.thruster_wrench
    order = np.random.default_rng(3).permutation(8)
    pulses = np.array([1600, 1450, 1700, 1500, 1530, 1900, 1100, 1520, *[1500] * 8], dtype=float)

    straight = MotorMap.of("vectored_6dof", wrench_B).commands(pulses)
    mixed = MotorMap.of("vectored_6dof", wrench_B[:, order]).commands(pulses)
    assert np.array_equal(mixed, straight[order])


def test_outputs_that_are_off_stop_the_motor():
    motors = ArduPilotDoor("vectored").motors
    pulses = np.zeros(16)
    assert not motors.commands(pulses).any()
    pulses[:6] = 65535.0
    assert not motors.commands(pulses).any()
    pulses[:6] = 2000.0  # beyond the motors' range, but a pulse: full speed
    assert np.array_equal(np.abs(motors.commands(pulses)), np.ones(6))


def test_at_rest_the_answer_has_all_fields_in_their_axes():
    door = ArduPilotDoor("vectored_6dof", water=DiveSite(depth=4.0, bottom=10.0))
    state = motion(door.reply(packet(0, rate=400)))

    assert state["timestamp"] == pytest.approx(1 / 400)
    assert state["imu"]["accel_body"] == pytest.approx([0.0, 0.0, -9.81], abs=1e-9)
    assert state["position"] == pytest.approx([0.0, 0.0, 4.0])
    assert state["velocity"] == pytest.approx([0.0] * 3, abs=1e-9)
    assert state["quaternion"] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-9)
    assert state["attitude"] == pytest.approx([0.0] * 3, abs=1e-9)
    assert state["rng_1"] == pytest.approx(6.0)


def test_specific_force_and_gyro_integrate_to_the_motion():
    door = ArduPilotDoor("vectored_6dof")
    pulses = [1650, 1400, 1560, 1430, 1560, 1440, 1530, 1480]
    state = motion(door.reply(packet(0, pulses, rate=1000)))

    for count in range(1, 400):
        before = state
        state = motion(door.reply(packet(count, pulses, rate=1000)))
        R_NB = rotation(state["quaternion"])
        gained = R_NB @ state["imu"]["accel_body"] + [0.0, 0.0, 9.81]
        change = np.subtract(state["velocity"], before["velocity"]) * 1000.0
        assert gained == pytest.approx(change, abs=1e-6)

        turned = rotation(before["quaternion"]).T @ R_NB
        skew = 0.5 * 1000.0 * (turned - turned.T)
        w = skew[[2, 0, 1], [1, 2, 0]]
        assert w == pytest.approx(state["imu"]["gyro"], abs=5e-3)

    assert np.linalg.norm(state["imu"]["gyro"]) > 0.3
    assert roll_pitch_yaw(np.array(state["quaternion"])) == pytest.approx(state["attitude"])


def rotation(quaternion):
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def test_a_current_carries_the_vehicle_to_its_speed():
    door = ArduPilotDoor("vectored_6dof", water=DiveSite(current_W=(0.3, -0.2, 0.0)))
    for count in range(2999):
        door.reply(packet(count))
    state = motion(door.reply(packet(2999)))
    assert state["velocity"] == pytest.approx([0.3, 0.2, 0.0], abs=0.02)  # 0.2 m/s to the east


def test_lockstep_answers_repeats_counts_losses_and_restarts():
    door = ArduPilotDoor("vectored")
    pulses = [1700] * 4
    first = door.reply(packet(7, pulses))
    second = door.reply(packet(8, pulses))
    assert motion(second)["timestamp"] == pytest.approx(2 / RATE)

    assert door.reply(packet(8, pulses)) == second  # came twice
    assert door.reply(packet(7, pulses)) == second  # came late
    third = door.reply(packet(12, pulses))  # three are missing: one packet, one frame
    assert motion(third)["timestamp"] == pytest.approx(3 / RATE)

    again = door.reply(packet(0, pulses))
    assert motion(again) == motion(first)

    traffic = door.traffic
    assert (traffic.stepped, traffic.repeated, traffic.late) == (4, 1, 1)
    assert (traffic.lost, traffic.restarts, traffic.refused) == (3, 1, 0)


def test_the_count_may_begin_anew_after_its_last():
    door = ArduPilotDoor("vectored")
    door.reply(packet(2**32 - 1))
    state = motion(door.reply(packet(0)))
    assert state["timestamp"] == pytest.approx(2 / RATE)
    assert not door.traffic.restarts


def test_a_count_far_ahead_is_a_gap_after_which_the_packets_are_stepped():
    door = ArduPilotDoor("vectored")
    door.reply(packet(0))
    for count in (1_000_000, 1_000_001):  # of an autopilot that was silent meanwhile
        state = motion(door.reply(packet(count)))
    assert state["timestamp"] == pytest.approx(3 / RATE)
    assert (door.traffic.lost, door.traffic.late, door.traffic.restarts) == (999_999, 0, 0)


def test_thirty_two_channels():
    assert len(servo_packet(packet(3, channels=32)).pulses) == 32
    door = ArduPilotDoor("vectored")
    assert door.reply(packet(0, [1600] * 6, channels=32)) == ArduPilotDoor("vectored").reply(
        packet(0, [1600] * 6)
    )


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "header"),
        (struct.pack("<HHI", 18458, 100, 0), "40"),
        (packet(0)[:-1], "40"),
        (packet(0) + b"\0", "40"),
        (b"\0" * 40, "magic number 0"),
        (packet(0, rate=0), "frame rate 0"),
        (packet(0, rate=50_000), "frame rate 50000"),
    ],
)
def test_what_is_no_packet_is_not_answered(data, message):
    with pytest.raises(ConfigurationError, match=message):
        servo_packet(data)
    door = ArduPilotDoor("vectored")
    assert door.reply(data) == b""
    assert door.traffic.refused == 1


def test_a_second_sender_is_not_answered_until_it_begins_anew():
    door = ArduPilotDoor("vectored")
    for count in range(20):
        door.reply(packet(count))
    assert door.reply(packet(4_000_000_000), interrupts=True) == b""
    assert door.reply(packet(7), interrupts=True) == b""
    assert (door.traffic.refused, door.traffic.restarts) == (2, 0)
    assert motion(door.reply(packet(20)))["timestamp"] == pytest.approx(21 / RATE)

    # An autopilot that was restarted has another port.
    assert motion(door.reply(packet(0), interrupts=True))["timestamp"] == pytest.approx(1 / RATE)


def test_random_datagrams_change_nothing():
    door = ArduPilotDoor("vectored")
    rng = np.random.default_rng(11)
    for size in rng.integers(0, 200, 500):
        assert door.reply(rng.bytes(int(size))) == b""
    assert motion(door.reply(packet(0)))["timestamp"] == pytest.approx(1 / RATE)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"frame": "cube"}, "vectored, vectored_6dof"),
        ({"frame": "vectored", "vehicle": "bluerov2_heavy"}, "6 motors"),
        ({"frame": "vectored", "vehicle": "uuv_puma"}, "no thruster of uuv_puma acts as motor"),
        ({"frame": "vectored", "vehicle": "phoenix_smart3s"}, "no thrusters"),
        ({"frame": "vectored", "directions": [1, 1]}, "for each of 6 motors"),
        ({"frame": "vectored", "directions": [1, 1, 1, 1, 1, 0]}, "1 or -1"),
        ({"frame": "vectored", "arm_channels": [9]}, "0 joints"),
    ],
)
def test_what_does_not_fit_is_refused(words, message):
    with pytest.raises(ConfigurationError, match=message):
        ArduPilotDoor(**words)


def test_spare_channels_move_the_arm_and_the_rest_hold_it():
    door = ArduPilotDoor(
        "vectored_6dof", vehicle="bluerov2_heavy_alpha5", arm_channels=[9, 10, 11, 12]
    )
    vehicle = door.vehicle.vehicle
    home = door.vehicle.data.qpos[vehicle.qpos].copy()
    share = (home - vehicle.q_limits[:, 0]) / (vehicle.q_limits[:, 1] - vehicle.q_limits[:, 0])
    pulses = np.round(1100 + 800 * share)
    pulses[1] += 80.0
    for count in range(3 * RATE):
        door.reply(packet(count, [1500] * 8 + list(pulses)))

    moved = door.vehicle.data.qpos[vehicle.qpos] - home
    width = vehicle.q_limits[:, 1] - vehicle.q_limits[:, 0]
    aims = vehicle.q_limits[:, 0] + (pulses - 1100) / 800 * width - home
    assert moved == pytest.approx(aims, abs=0.02)
    assert moved[1] > 0.1


class Autopilot(threading.Thread):
    """A client after the public document: 100 Hz, depth hold and yaw by PD, on its own motors."""

    def __init__(self, port, factors):
        super().__init__(daemon=True)
        self.port, self.factors, self.depths = port, factors, []

    def run(self):
        import socket

        integral, pulses = 0.0, np.full(len(self.factors), 1500.0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
            link.settimeout(20.0)
            link.connect(("127.0.0.1", self.port))

            for count in range(20 * RATE):
                link.send(packet(count, pulses))
                state = json.loads(link.recv(4096))
                self.depths.append(state["position"][2])
                error = self.depths[-1] - 3.0
                integral += error / RATE

                climb = 0.8 * error + 0.15 * integral + 0.8 * state["velocity"][2]
                roll, pitch, yaw = state["attitude"]
                rates = state["imu"]["gyro"]
                angles = np.array([-roll, -pitch, 0.5 - yaw]) - 0.3 * np.array(rates)
                # yaw's gain: within 0.05 rad of the aim the demand leaves the T200's dead band
                demand = np.array([*([0.5, 0.5, 2.0] * angles), climb, 0.0, 0.0])
                pulses = 1500 + 400 * np.clip(self.factors @ demand, -1.0, 1.0)


def test_a_foreign_controller_holds_depth_and_heading_over_the_socket(door):
    motors = len(door.motors.thrusters)
    begun(door)
    with datagrams.listening(0) as endpoint:
        autopilot = Autopilot(endpoint.port, FRAMES["vectored" if motors == 6 else "vectored_6dof"])
        autopilot.start()
        datagrams.answer_all(endpoint, door.reply, lambda: not autopilot.is_alive())

    assert len(autopilot.depths) == 20 * RATE
    assert np.abs(np.array(autopilot.depths[-5 * RATE :]) - 3.0).max() < 0.05
    yaw = 2.0 * math.atan2(-door.vehicle.quat_WB_wxyz[3], door.vehicle.quat_WB_wxyz[0])
    assert yaw == pytest.approx(0.5, abs=0.05)


def test_after_a_count_that_leaps_ahead_each_packet_is_a_step():
    door = ArduPilotDoor("vectored")
    door.reply(packet(0))
    door.reply(packet(1))
    states = [motion(door.reply(packet(200_000 + row))) for row in range(3)]
    assert [state["timestamp"] for state in states] == pytest.approx([0.03, 0.04, 0.05])
    traffic = door.traffic
    assert (traffic.late, traffic.restarts, traffic.lost) == (0, 0, 199_998)
