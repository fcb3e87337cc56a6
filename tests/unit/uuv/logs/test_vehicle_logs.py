"""Logs of autopilots and ROS recorders, written by their own libraries, read into our axes."""

import resource
import struct
from collections import Counter
from importlib.util import find_spec

import numpy as np
import pytest

if find_spec("rosbags") is None:  # nor is the rest of the extra `bridge`
    pytest.skip("rosbags is not here", allow_module_level=True)

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from uuv import models
from uuv.calib.water.logs import ATTITUDE, FORCE, RATE
from uuv.export.topics import RosTypes
from uuv.logs import gathered, vehicle_log
from uuv.logs.ardusub_frames import FRAMES
from uuv.logs.readers import quaternion_xyzw, read_vehicle_log
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.water_identification.vehicle_logs import read_as_water_log

DIRECTIONS = (-1, -1, 1, 1, -1, 1, 1, -1)
ANGLES = (0.1, -0.25, 1.3)  # [rad] roll, pitch, yaw in NED
RATES = (0.2, -0.1, 0.3)  # [rad/s] forward, right, down
N = 120


def pulses_at(row):
    rng = np.random.default_rng(row)
    return rng.integers(1350, 1650, 8)


@pytest.fixture(scope="module")
def tlog(tmp_path_factory):
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    others = [  # a ground station, a camera on board, another vehicle
        mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        for system, component in ((255, 1), (1, 100), (7, 1))
    ]
    messages = [(0.0, link.param_value_encode(b"FRAME_CONFIG", 2.0, 9, 9, 0))]
    messages += [
        (0.0, link.param_value_encode(f"MOT_{n}_DIRECTION".encode(), float(sign), 9, 9, n))
        for n, sign in enumerate(DIRECTIONS, 1)
    ]

    for row in range(N):
        boot = 5000 + 50 * row
        time = 0.05 * row
        messages += [
            (time, link.attitude_encode(boot, *ANGLES, *RATES)),
            (time, link.local_position_ned_encode(boot, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0)),
            (time, link.vfr_hud_encode(0.0, 0.0, 90, 0, -3.5, 0.0)),
            (time, link.raw_imu_encode(1000 * boot, 0, 0, -1000, 0, 0, 0, 0, 0, 0)),
            (time, link.servo_output_raw_encode(1000 * boot, 0, *map(int, pulses_at(row)))),
        ]

    file = tmp_path_factory.mktemp("logs") / "dive.tlog"
    packed = [(time, message.pack(link)) for time, message in messages]
    for other in others:
        foreign = other.attitude_encode(5000 + 50 * N, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        packed.append((0.05 * N, foreign.pack(other)))
    packed.insert(0, packed[-3])  # the ground station speaks first

    stamps = [struct.pack(">Q", 1_700_000_000_000_000 + round(1e6 * time)) for time, _ in packed]
    file.write_bytes(
        b"".join(stamp + data for stamp, (_, data) in zip(stamps, packed, strict=True))
    )
    return file


@pytest.fixture(scope="module")
def flash(tmp_path_factory):
    """A dataflash log: self-describing messages after the public format."""
    head = b"\xa3\x95"

    def described(number, name, form, labels):
        letters = form.replace("N", "16s").replace("e", "i")  # as struct has them
        size = 3 + struct.calcsize("<" + letters)
        return head + struct.pack(
            "<BBB4s16s64s", 128, number, size, name.encode(), form.encode(), labels.encode()
        )

    parts = [
        head
        + struct.pack(
            "<BBB4s16s64s", 128, 128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns"
        ),
        described(1, "PARM", "QNf", "TimeUS,Name,Value"),
        described(2, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw"),
        described(3, "IMU", "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
        described(4, "RCOU", "QHHHHHHHH", "TimeUS," + ",".join(f"C{n}" for n in range(1, 9))),
    ]
    parameters = {"FRAME_CONFIG": 2.0}
    parameters |= {f"MOT_{n}_DIRECTION": float(sign) for n, sign in enumerate(DIRECTIONS, 1)}
    parts += [
        head + struct.pack("<BQ16sf", 1, 1000, name.encode(), value)
        for name, value in parameters.items()
    ]
    for row in range(N):
        time = 2000 + 50_000 * row
        parts += [
            head + struct.pack("<BQfff", 2, time, *np.degrees(ANGLES)),
            head + struct.pack("<BQBffffff", 3, time, 0, *RATES, 0.0, 0.0, -9.80665),
            head
            + struct.pack("<BQBffffff", 3, time, 1, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0),  # second unit
            head + struct.pack("<BQ8H", 4, time, *pulses_at(row)),
        ]
    file = tmp_path_factory.mktemp("logs") / "dive.BIN"
    file.write_bytes(b"".join(parts))
    return file


@pytest.fixture(scope="module")
def vehicle():
    return Vehicle.of(models.load("bluerov2_heavy").compile())


@pytest.fixture(params=["tlog", "flash"])
def file(request):
    return request.getfixturevalue(request.param)


def test_angles_of_the_autopilot_are_turned_into_our_axes():
    roll, pitch, yaw = ANGLES
    R_WB = Rotation.from_quat(quaternion_xyzw(roll, pitch, yaw)).as_matrix()
    # The bow, by its own definition: yaw from north to east, pitch up; east is -y here.
    bow = [np.cos(pitch) * np.cos(yaw), -np.cos(pitch) * np.sin(yaw), np.sin(pitch)]
    assert R_WB[:, 0] == pytest.approx(bow)
    # A roll to the right lowers starboard, which is -y of the hull.
    assert -R_WB[2, 1] == pytest.approx(-np.cos(pitch) * np.sin(roll))


def test_streams_are_in_si_units_and_our_axes(file):
    log = read_vehicle_log(file)
    streams = log.streams
    assert log.frame == "vectored_6dof"
    assert log.directions == DIRECTIONS
    assert log.lacking() == []

    attitude = streams[vehicle_log.ATTITUDE]
    assert len(attitude.time) == N
    assert attitude.rate == pytest.approx(20.0, rel=1e-6)
    expected = quaternion_xyzw(*ANGLES)
    assert np.abs(attitude.values @ expected) == pytest.approx(np.ones(N), abs=1e-6)

    assert streams[vehicle_log.RATE].values[0] == pytest.approx([0.2, 0.1, -0.3], rel=1e-6)
    assert streams[vehicle_log.FORCE].values[0] == pytest.approx([0, 0, 9.80665], abs=0.005)
    assert streams[vehicle_log.PULSES].values[7, :8].tolist() == pulses_at(7).tolist()


def test_telemetry_has_position_and_depth(tlog):
    streams = read_vehicle_log(tlog).streams
    assert streams[vehicle_log.POSITION].values[3] == pytest.approx([1.0, -2.0, -3.0])
    assert streams[vehicle_log.DEPTH].values[3] == pytest.approx([3.5])


def test_pulses_become_commands_of_the_vehicles_thrusters(file, vehicle):
    log = read_as_water_log(file, vehicle, thrusters=vehicle.thruster_names, joints={})
    assert set(log.channels) >= {ATTITUDE, RATE, FORCE}

    # The wrench that the frame's factors mean is what the thrusters give, by their levers.
    row = 40
    speeds = (pulses_at(row) - 1500.0) / 400.0 * np.array(DIRECTIONS)
    demand = FRAMES["vectored_6dof"].T @ speeds
    at = np.searchsorted(log.time, 0.05 * row + 0.03) - 1  # each is held until the next
    commands = np.array([log.commands[name][at] for name in vehicle.thruster_names])
    wrench_B = vehicle.thruster_wrench @ commands
    yaw_heave_surge_sway = np.array([-wrench_B[5], wrench_B[2], wrench_B[0], -wrench_B[1]])
    levers = np.abs(vehicle.thruster_wrench[[5, 2, 0, 1]]).max(axis=1)
    assert yaw_heave_surge_sway == pytest.approx(levers * demand[2:], abs=1e-9)


def test_outputs_of_another_frame_are_refused(file):
    six = Vehicle.of(models.load("bluerov2").compile())
    with pytest.raises(ConfigurationError, match="has 8 motors, the vehicle has 6 thrusters"):
        read_as_water_log(file, six, thrusters=six.thruster_names, joints={})


def test_a_cut_file_is_read_up_to_there_and_a_foreign_one_refused(file, tmp_path):
    whole = file.read_bytes()
    cut = tmp_path / f"cut{file.suffix}"
    cut.write_bytes(whole[: len(whole) // 2])
    log = read_vehicle_log(cut)
    assert 0.3 * N < len(log.streams[vehicle_log.ATTITUDE].time) < 0.7 * N

    cut.write_bytes(b"\0" * 3000)
    with pytest.raises(ConfigurationError, match="has no message"):
        read_vehicle_log(cut)


DAMAGE = ("overwritten", "cut out", "doubled", "cut off")


def damaged(whole, rng):
    """A log that was damaged in one way, and that way."""
    content = bytearray(whole)
    at = int(rng.integers(len(content) // 4, len(content) - 600))  # what follows is not the end
    length = int(rng.integers(1, 200))
    way = DAMAGE[int(rng.integers(len(DAMAGE)))]
    if way == "overwritten":
        for place in rng.integers(0, len(content), 10):
            content[place] = rng.integers(256)
    elif way == "cut out":
        del content[at : at + length]
    elif way == "doubled":
        content[at:at] = content[at : at + length]
    else:
        del content[at:]
    return bytes(content), way


def check_damage(source, folder, trials, seed):
    """Damaged logs are read, with a note where samples are lost, or refused; how many of each."""
    whole = source.read_bytes()
    rng = np.random.default_rng(seed)
    file = folder / f"damaged{source.suffix}"
    outcomes = Counter()
    for _ in range(trials):
        content, way = damaged(whole, rng)
        file.write_bytes(content)
        log = read_or_refuse(file)
        outcomes["read" if log else "refused"] += 1
        for stream in log.streams.values() if log else ():
            assert np.isfinite(stream.values).all()
            assert (np.diff(stream.time) > 0).all()
        if log and any(len(stream.time) < N for stream in log.streams.values()) and not log.notes:
            outcomes[f"silent, {way}"] += 1
    return outcomes


@pytest.mark.parametrize("kind", ["tlog", "flash", "bag"])
def test_damage_is_read_or_refused_in_one_line_and_never_silent(kind, request, tmp_path):
    outcomes = check_damage(request.getfixturevalue(kind), tmp_path, trials=4, seed=17)
    assert sum(outcomes.values()) >= 4
    assert not {name for name in outcomes if name.startswith("silent")} - {"silent, cut off"}


@pytest.mark.long(
    guarded_by="tests/unit/uuv/logs/test_vehicle_logs.py::"
    "test_damage_is_read_or_refused_in_one_line_and_never_silent"
)
@pytest.mark.parametrize(("kind", "trials"), [("tlog", 170), ("flash", 170), ("bag", 160)])
def test_500_damaged_logs_cost_bounded_memory(kind, trials, request, tmp_path):
    """What is lost is noted; a file that only ends early is as long as it says. In a .tlog the next
    message is found so well that a few losses leave no trace.
    """
    source = request.getfixturevalue(kind)
    # Resident memory: a forged length is asked for as a whole, but none of it is ever written.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcomes = check_damage(source, tmp_path, trials, seed=23)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    print(kind, dict(outcomes), f"{grown / 1e6:.0f} MB")
    assert outcomes["read"] > trials // 10
    silent = sum(outcomes[f"silent, {way}"] for way in DAMAGE if way != "cut off")
    assert silent <= (5 if kind == "tlog" else 0)  # measured 3 of 170
    assert grown < 200e6


def test_a_time_that_is_wrong_costs_one_sample(flash, tmp_path):
    content = bytearray(flash.read_bytes())
    at = content.index(b"\xa3\x95\x02", len(content) // 2) + 3  # TimeUS of an ATT
    content[at + 6] ^= 0x40
    file = tmp_path / "flipped.BIN"
    file.write_bytes(content)

    log = read_vehicle_log(file)
    assert len(log.streams[vehicle_log.ATTITUDE].time) == N - 1
    assert log.duration == pytest.approx(read_vehicle_log(flash).duration, abs=0.1)
    assert any("time does not rise" in line for line in log.notes)


def read_or_refuse(file):
    """The log, or None where it is refused; anything else that is raised fails the test."""
    try:
        return read_vehicle_log(file)
    except ConfigurationError:
        return None


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag of another's recorder: IMU, DVL, pressure, joint states; the MCAP file in it."""
    types = RosTypes()
    kinds = get_typestore(Stores.ROS2_HUMBLE).types
    folder = tmp_path_factory.mktemp("bags") / "dive"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            kind: writer.add_connection(topic, kind, typestore=types.store)
            for topic, kind in (
                ("/imu/data", "sensor_msgs/msg/Imu"),
                ("/dvl", "geometry_msgs/msg/TwistWithCovarianceStamped"),
                ("/pressure", "sensor_msgs/msg/FluidPressure"),
                ("/notes", "std_msgs/msg/String"),
            )
        }
        zero = np.zeros(9)
        for row in range(N):
            time = 100.0 + 0.02 * row
            header = types.header(time, "base_link")
            imu = kinds["sensor_msgs/msg/Imu"](
                header,
                types.quaternion(np.array([1.0, 0, 0, 0])),
                zero - 1.0,
                types.vector(np.array([0.1, 0.2, 0.3])),
                zero,
                types.vector(np.array([0.0, 0.0, 9.81])),
                zero,
            )
            twist = types.make(
                "Twist",
                linear=types.vector(np.array([0.4, 0.0, 0.1])),
                angular=types.vector(np.zeros(3)),
            )
            dvl = kinds["geometry_msgs/msg/TwistWithCovarianceStamped"](
                header, types.make("TwistWithCovariance", twist=twist, covariance=np.zeros(36))
            )
            pressure = kinds["sensor_msgs/msg/FluidPressure"](
                header, 101_325.0 + 1025.0 * 9.81 * 2.0, 0.0
            )
            for message in (imu, dvl, pressure):
                kind = message.__msgtype__
                data = types.encoded(kind, message)
                writer.write(topics[kind], round(1e9 * time), data)
    return folder / "dive.mcap"


@pytest.mark.parametrize("as_folder", [True, False])
def test_topics_are_taken_by_their_types(bag, as_folder):
    log = read_vehicle_log(bag.parent if as_folder else bag)
    assert log.streams[vehicle_log.RATE].values[5] == pytest.approx([0.1, 0.2, 0.3])
    assert log.streams[vehicle_log.VELOCITY].values[5] == pytest.approx([0.4, 0.0, 0.1])
    assert log.streams[vehicle_log.DEPTH].values[5] == pytest.approx([2.0], rel=2e-3)
    assert log.streams[vehicle_log.RATE].rate == pytest.approx(50.0)
    assert vehicle_log.ATTITUDE not in log.streams  # its covariance says that it is not measured
    assert any("no servo outputs" in line for line in log.lacking())


@pytest.mark.parametrize(
    ("name", "message"),
    [("none.tlog", "no such file"), ("cloud.ply", ".tlog"), ("folder", "no ROS bag")],
)
def test_what_is_no_log_is_refused(name, message, tmp_path):
    (tmp_path / "cloud.ply").write_text("ply")
    (tmp_path / "folder").mkdir()
    with pytest.raises(ConfigurationError, match=message):
        read_vehicle_log(tmp_path / name)


def test_the_verb_says_rates_motors_and_what_is_missing(tlog, tmp_path, monkeypatch, capsys):
    import json
    import sys

    from uuv.cli.main import main

    monkeypatch.setattr(
        sys, "argv", ["uuv", "logs", str(tlog), "--json", "--picture", str(tmp_path / "log.png")]
    )
    with pytest.raises(SystemExit) as ended:
        main()
    content = json.loads(capsys.readouterr().out)
    assert ended.value.code == 0
    assert content["frame"] == "vectored_6dof"
    assert content["streams"]["servo pulses"]["rate_hz"] == pytest.approx(20.0)
    assert (tmp_path / "log.png").read_bytes()[:4] == b"\x89PNG"


def telemetry(file, packets):
    """A .tlog of (recorder's time [s], message) of one vehicle."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    stamped = [
        struct.pack(">Q", round(1e6 * (1_700_000_000 + time))) + message(link).pack(link)
        for time, message in packets
    ]
    file.write_bytes(b"".join(stamped))
    return read_vehicle_log(file)


def test_microseconds_of_32_bits_begin_anew(tmp_path):
    def servo(boot):
        return lambda link: link.servo_output_raw_encode(round(1e6 * boot) % 2**32, 0, *[1500] * 8)

    def attitude(boot):
        return lambda link: link.attitude_encode(round(1e3 * boot), *ANGLES, *RATES)

    begin = 4290.0  # [s] since the vehicle's start; the wrap is at 4294.967
    packets = []
    for row in range(100):
        packets += [(0.1 * row, attitude(begin + 0.1 * row)), (0.1 * row, servo(begin + 0.1 * row))]
    streams = telemetry(tmp_path / "long.tlog", packets).streams
    pulses = streams[vehicle_log.PULSES]
    assert len(pulses.time) == 100
    assert pulses.time == pytest.approx(streams[vehicle_log.ATTITUDE].time, abs=1e-3)


def test_a_vehicle_that_restarts_goes_on_in_time(tmp_path):
    def attitude(boot):
        return lambda link: link.attitude_encode(round(1e3 * boot), *ANGLES, *RATES)

    before = [(0.1 * row, attitude(50.0 + 0.1 * row)) for row in range(40)]
    after = [(10.0 + 0.1 * row, attitude(2.0 + 0.1 * row)) for row in range(40)]
    log = telemetry(tmp_path / "restarted.tlog", [*before, *after])
    time = log.streams[vehicle_log.ATTITUDE].time
    assert len(time) == 80
    assert time[40] == pytest.approx(10.0, abs=0.01)
    assert any("restarted 1 times" in line for line in log.notes)


def test_a_filter_without_a_source_of_position_gives_none(tmp_path):
    def status(flags):
        return lambda link: link.ekf_status_report_encode(flags, 0, 0, 0, 0, 0)

    def position(boot):
        return lambda link: link.local_position_ned_encode(
            round(1e3 * boot), 1.0, 2.0, 3.0, 0.0, 0.0, 0.0
        )

    def packets(flags):
        return [(0.0, status(flags)), *((0.1 * row, position(5 + 0.1 * row)) for row in range(9))]

    assert vehicle_log.POSITION in telemetry(tmp_path / "placed.tlog", packets(831)).streams
    log = telemetry(tmp_path / "still.tlog", packets(0x00A7))
    assert vehicle_log.POSITION not in log.streams
    assert any("9 samples left out" in line for line in log.notes)


def test_a_direction_that_is_missing_leaves_all_unknown(tmp_path, vehicle):
    def parameter(name, value):
        return lambda link: link.param_value_encode(name.encode(), value, 9, 9, 0)

    packets = [(0.0, parameter("FRAME_CONFIG", 2.0))]
    packets += [(0.0, parameter(f"MOT_{n}_DIRECTION", 1.0)) for n in range(1, 9) if n != 3]
    for row in range(60):
        packets += [
            (
                0.1 * row,
                lambda link, row=row: link.attitude_encode(5000 + 100 * row, *ANGLES, *RATES),
            ),
            (
                0.1 * row,
                lambda link, row=row: link.servo_output_raw_encode(
                    5_000_000 + 100_000 * row, 0, *[1600] * 8
                ),
            ),
        ]
    log = telemetry(tmp_path / "less.tlog", packets)
    assert log.directions == ()
    assert log.driven == 1.0
    assert any("MOT_n_DIRECTION" in line for line in log.lacking())
    with pytest.raises(ConfigurationError, match="MOT_n_DIRECTION"):
        read_as_water_log(
            tmp_path / "less.tlog", vehicle, thrusters=vehicle.thruster_names, joints={}
        )


@pytest.fixture
def joints(tmp_path):
    """A bag of two topics with joint states; the names of the first one change their order."""
    types = RosTypes()
    folder = tmp_path / "arm"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kind = "sensor_msgs/msg/JointState"
        arm, gripper = (
            writer.add_connection(topic, kind, typestore=types.store)
            for topic in ("/joint_states", "/gripper/joint_states")
        )
        for row in range(20):
            names = ["a", "b"] if row % 2 == 0 else ["b", "a"]
            for topic, name, value in (
                (arm, names, [1.0, 2.0] if row % 2 == 0 else [2.0, 1.0]),
                (gripper, ["left", "right"], [8.0, 9.0]),
            ):
                message = types.make(
                    "JointState",
                    header=types.header(0.1 * row + 1.0, ""),
                    name=name,
                    position=np.array(value),
                    velocity=np.zeros(2),
                    effort=np.zeros(2),
                )
                writer.write(topic, round(1e8 * row + 1e9), types.encoded(kind, message))
    return folder


def test_joints_keep_their_names_whatever_their_order_and_other_topics(joints):
    stream = read_vehicle_log(joints).streams[vehicle_log.JOINTS]
    assert stream.labels == ("a", "b")
    assert np.array_equal(stream.values, np.tile([1.0, 2.0], (20, 1)))


def test_a_bag_without_a_type_that_is_read_says_so(tmp_path):
    types = RosTypes()
    kind = "std_msgs/msg/String"
    with Writer(tmp_path / "talk", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/chatter", kind, typestore=types.store)
        writer.write(topic, 0, types.encoded(kind, types.make("String", data="hello")))
    with pytest.raises(ConfigurationError, match="std_msgs/msg/String"):
        read_vehicle_log(tmp_path / "talk")


@pytest.mark.parametrize("begin", [0.2, 4294.5])
def test_a_message_without_a_time_has_the_recorders(begin, tmp_path):
    """Depths of VFR_HUD, also where a clock of 32 bits begins anew."""

    def attitude(boot):
        return lambda link: link.attitude_encode(round(1e3 * boot), *ANGLES, *RATES)

    def hud(depth):
        return lambda link: link.vfr_hud_encode(0.0, 0.0, 0, 0, -depth, 0.0)

    packets = []
    for row in range(20):
        packets += [(0.05 * row, attitude(begin + 0.05 * row)), (0.05 * row, hud(0.1 * row))]
    log = telemetry(tmp_path / "hud.tlog", packets)
    depth = log.streams[vehicle_log.DEPTH]
    assert np.diff(depth.time) == pytest.approx(np.full(19, 0.05), abs=2e-3)
    assert depth.values[:, 0] == pytest.approx(0.1 * np.arange(20), abs=1e-6)
    assert not any("does not rise" in line for line in log.notes)


def test_a_cut_file_with_too_many_messages_is_refused(bag, tmp_path, monkeypatch):
    (tmp_path / "cut.mcap").write_bytes(bag.read_bytes()[:-200])
    assert read_vehicle_log(tmp_path / "cut.mcap").messages > 20
    monkeypatch.setattr(gathered, "MOST", 20)
    with pytest.raises(ConfigurationError, match="more than 20 messages"):
        read_vehicle_log(tmp_path / "cut.mcap")
