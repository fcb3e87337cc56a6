"""A run's data in other tools' formats, read back by their own readers."""

import csv
import json
import shutil
import sys
from importlib.util import find_spec
from types import SimpleNamespace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

if find_spec("rosbags") is None:  # nor is the rest of the extra `bridge`
    pytest.skip("rosbags is not here", allow_module_level=True)

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from rosbags.highlevel import AnyReader
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from run_records import every_run
from untyped import untyped
from uuv import models
from uuv.assembly import assemble
from uuv.cli import logs
from uuv.cli.main import main
from uuv.export import live_log
from uuv.export.files import write_bag
from uuv.export.robot_description import robot_description
from uuv.export.topics import RosTypes, RunTopics, Topic, twists_of
from uuv.jobs import clean_barrel
from uuv.models.naming import body_label
from uuv.models.vehicle import Vehicle
from uuv.runner import run_through
from uuv.scenario_file import to_toml
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.logged_columns import REFERENCE, SCALARS, VECTORS, slow_columns
from uuv.sim.loop.recording import STATES, Recorder
from uuv.sim.reporting import series_tables
from uuv.sim.reporting.series_files import Column, write_table
from uuv.sim.reporting.series_tables import PastRun

N = 60  # rows at the loop's rate
JOINTS = tuple(f"joint{i}" for i in range(1, 7))


def columns_of(blocks, time, rng):
    columns = [Column("time", time, "s")]
    for name, (labels, unit) in blocks.items():
        value = rng.normal(size=(len(time), max(1, len(labels))))
        if name.startswith("quat"):
            value = Rotation.random(len(time), rng=rng).as_quat(scalar_first=True)
        if name == "state":
            value[:] = STATES.index(WorkState.WORK)
        columns += [
            Column(f"{name}.{label}", value[:, i], unit, name) for i, label in enumerate(labels)
        ] or [Column(name, value[:, 0], unit, name)]
    return columns


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of a run with random series, in turned poses."""
    folder = tmp_path_factory.mktemp("runs") / "drawn"
    folder.mkdir()
    rng = np.random.default_rng(5)
    (folder / "scenario.toml").write_text(to_toml(clean_barrel(seed=4, quick=True)))
    (folder / "metrics.json").write_text(json.dumps(every_run(simulated_s=0.12)))

    model = models.load("uuv_puma").compile()
    time = 0.002 * np.arange(N)
    slow = slow_columns(Vehicle.of(model))
    write_table(folder / "series_loop", columns_of({**SCALARS, **VECTORS, **REFERENCE}, time, rng))
    write_table(folder / "series_slow", columns_of(slow, time[::10], rng))

    poses = [Column("time", time[::20], "s")]
    for body in ("world", "hull", "link1"):
        place = rng.normal(size=(3, 3))
        attitude = Rotation.random(3, rng=rng).as_quat(scalar_first=True)
        parts = zip(
            ("x", "y", "z", "qw", "qx", "qy", "qz"), np.hstack([place, attitude]).T, strict=True
        )
        poses += [
            Column(f"body_pose.{body}.{part}", value, "m, wxyz", "body_pose")
            for part, value in parts
        ]
    write_table(folder / "series_poses", poses)

    points = rng.normal(size=(40, 3))
    write_table(folder / "cloud_scan", [Column(a, points[:, k], "m") for k, a in enumerate("xyz")])
    texts = {"state": ["work", "abort"], "note": ["", "63 N"], "abort": ["", "force limit"]}
    write_table(
        folder / "events",
        [
            Column("time", np.array([0.0, 0.1]), "s"),
            *(Column(name, np.array(words)) for name, words in texts.items()),
        ],
    )
    return folder


@pytest.fixture
def export(folder, monkeypatch, capsys):
    """The verb, on the run; gives exit code and output."""

    def call(*words, run=folder):
        monkeypatch.setattr(sys, "argv", ["uuv", "export", str(run), *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        printed = capsys.readouterr()
        return ended.value.code, printed.out + printed.err

    return call


@pytest.fixture(scope="module")
def run(folder):
    return PastRun.of(folder).recorded


def messages_by_topic(path):
    with AnyReader([path]) as bag:
        by_topic = {}
        for connection, stamp, raw in bag.messages():
            message = bag.deserialize(raw, connection.msgtype)
            by_topic.setdefault(connection.topic, []).append((stamp, message))
        return by_topic


def xyz(vector):
    return [vector.x, vector.y, vector.z]


@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_messages_are_the_series_by_the_readers_of_ros(kind, export, folder, run, tmp_path):
    target = tmp_path / ("run.mcap" if kind == "mcap" else "bag")
    code, text = export(f"--{kind}", target)
    assert code == 0, text
    read = messages_by_topic(target)

    # Every series is on some topic, with all its rows.
    counts = {topic: len(stamped) for topic, stamped in read.items()}
    assert counts["/joint_states"] == counts["/thrusters"] == N // 10
    assert counts["/odometry"] == counts["/tool/contact"] == counts["/series/set_force"] == N
    assert (counts["/tf"], counts["/events"], counts["/clouds/scan"]) == (3, 2, 1)

    for i in (0, -1):
        stamp, joints = read["/joint_states"][i]
        assert stamp == round(1e9 * run["q"].time[i])
        assert joints.name == list(JOINTS)
        assert np.array_equal(joints.position, run["q"].value[i])
        assert np.array_equal(joints.effort, run["tau_drive"].value[i])

        _, wrench = read["/tool/contact"][i]
        assert xyz(wrench.wrench.force) == run["contact_force"].value[i].tolist()
        assert wrench.header.frame_id == "world"

        _, odometry = read["/odometry"][i]
        assert xyz(odometry.pose.pose.position) == run["p_WB"].value[i].tolist()
        turned = odometry.pose.pose.orientation
        assert [turned.w, *xyz(turned)] == run["quat_WB_wxyz"].value[i].tolist()

        _, estimate = read["/odometry/estimate"][i]
        covariance = estimate.pose.covariance.reshape(6, 6)
        assert np.diag(covariance)[:3] == pytest.approx(run["position_sigma"].value[i] ** 2)

        _, force = read["/series/set_force"][i]
        assert force.data.tolist() == run["set_force"].value[i].tolist()
        assert force.layout.dim[0].label == "set_force[N]"

        _, poses = read["/tf"][i]
        assert [t.child_frame_id for t in poses.transforms] == ["hull", "link1"]
        rows = run["body_pose"].value[i].reshape(-1, 7)
        assert xyz(poses.transforms[1].transform.translation) == rows[2, :3].tolist()

    _, ended = read["/events"][-1]
    assert (ended.level, ended.msg) == (40, "abort (force limit): 63 N")
    _, cloud = read["/clouds/scan"][0]
    points = cloud.data.view("<f4").reshape(-1, 3)
    assert np.array_equal(points, PastRun.of(folder).clouds["scan"].astype("<f4"))
    assert "<robot" in read["/robot_description"][0][1].data


def test_what_stays_valid_is_latched_in_the_bag_as_in_the_mcap_file(export, tmp_path):
    assert export("--mcap", tmp_path / "run.mcap", "--bag", tmp_path / "bag")[0] == 0
    for path in (tmp_path / "run.mcap", tmp_path / "bag"):
        with AnyReader([path]) as bag:
            profiles = {c.topic: untyped(c.ext).offered_qos_profiles for c in bag.connections}
        latched = {topic: qos for topic, qos in profiles.items() if qos}
        assert set(latched) == {"/robot_description", "/clouds/scan"}
        assert {qos[0].durability.name for qos in latched.values()} == {"TRANSIENT_LOCAL"}


def test_messages_are_in_the_order_of_time(export, tmp_path):
    from mcap.reader import make_reader

    assert export("--mcap", tmp_path / "run.mcap")[0] == 0
    with open(tmp_path / "run.mcap", "rb") as file:
        stamps = [m.log_time for _, _, m in make_reader(file).iter_messages(log_time_order=False)]
    assert stamps == sorted(stamps)


def test_tables_as_csv_have_all_digits_and_units(export, run, tmp_path):
    assert export("--csv", tmp_path / "tables")[0] == 0
    with open(tmp_path / "tables" / "slow.csv", newline="") as file:
        head, *rows = csv.reader(file)
    assert head[:2] == ["time [s]", "q.joint1 [rad]"]
    column = head.index("thrust.sway [N]")
    sway = run["thrust"].value[:, run["thrust"].labels.index("sway")]
    assert [float(row[column]) for row in rows] == sway.tolist()
    assert (tmp_path / "tables" / "events.csv").read_text().splitlines()[2] == (
        "0.1,abort,63 N,force limit"
    )
    with open(tmp_path / "tables" / "states.csv", newline="") as file:
        states = {int(row["state"]): row["name"] for row in csv.DictReader(file)}
    assert [states[int(number)] for number in run["state"].scalar[[0, -1]]] == ["work", "work"]


def test_a_matlab_file_has_a_matrix_for_each_series(export, run, tmp_path):
    assert export("--mat", tmp_path / "run.mat")[0] == 0
    read = loadmat(tmp_path / "run.mat", simplify_cells=True)
    assert np.array_equal(read["slow"]["q"], run["q"].value)
    assert read["slow"]["units"]["q"] == "rad"
    assert np.array_equal(read["loop"]["time"], run["set_force"].time)
    assert read["poses"]["body_pose_hull"].shape == (3, 7)
    assert read["events"]["state"].tolist() == ["work", "abort"]
    states = dict(zip(read["states"]["state"], read["states"]["name"], strict=True))
    assert [states[number] for number in read["loop"]["state"][[0, -1]]] == ["work", "work"]


def test_several_formats_at_once_and_as_json(export, tmp_path):
    code, text = export("--mcap", tmp_path / "a.mcap", "--mat", tmp_path / "a.mat", "--json")
    written = json.loads(text)
    assert code == 0
    assert written[str(tmp_path / "a.mat")] == 0
    assert written[str(tmp_path / "a.mcap")] > N


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "at least one of --mcap, --bag, --csv, --mat"),
        (["--mcap", "nowhere/run.mcap"], "no folder 'nowhere'"),
        (["--bag", "."], "exists already"),
    ],
)
def test_what_cannot_be_written_is_said_in_one_line(words, message, export):
    code, text = export(*words)
    assert code == 2
    assert message in text
    assert text.count("\n") == 1


def test_a_cloud_of_other_columns_is_refused(folder, tmp_path, export):
    import shutil

    other = shutil.copytree(folder, tmp_path / "other")
    write_table(other / "cloud_scan", [Column("x", np.zeros(3), "m")])
    code, text = export("--mcap", tmp_path / "run.mcap", run=other)
    assert code == 2
    assert "columns x, y, z" in text


def test_twists_are_those_of_a_steady_turn():
    time = np.linspace(0.0, 2.99, 300)
    w_B = np.array([0.3, -0.2, 0.5])
    start = Rotation.from_rotvec([0.4, 0.7, -0.2])
    attitude = start * Rotation.from_rotvec(time[:, None] * w_B)
    v_W = np.array([0.1, 0.2, -0.3])
    twists = twists_of(time, time[:, None] * v_W, attitude.as_quat(scalar_first=True))

    assert twists[:, 3:] == pytest.approx(np.tile(w_B, (300, 1)), abs=1e-9)
    assert twists[:, :3] == pytest.approx(attitude.inv().apply(v_W), abs=1e-9)


@pytest.mark.parametrize("name", ["uuv_puma", "bluerov2_heavy_alpha5", "rexrov2_arm7"])
def test_the_description_moves_as_the_model(name):
    model = hydrodynamics.compile(models.load(name))
    vehicle = Vehicle.of(model)
    urdf = mujoco.MjSpec.from_string(robot_description(model))
    urdf.compiler.fusestatic = False
    urdf.compiler.discardvisual = False
    urdf.compiler.balanceinertia = True
    read = urdf.compile()

    rng = np.random.default_rng(2)
    data = mujoco.MjData(model)
    other = mujoco.MjData(read)
    q = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1])
    data.qpos[vehicle.qpos] = q
    for joint, angle in zip(vehicle.joint_names, q, strict=True):
        other.joint(joint).qpos[0] = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_kinematics(read, other)

    R_WB = data.xmat[vehicle.hull].reshape(3, 3)
    tip = int(model.site_bodyid[vehicle.tip])
    expected = R_WB.T @ (data.xpos[tip] - data.xpos[vehicle.hull])
    assert other.body(model.body(tip).name).xpos == pytest.approx(expected, abs=1e-8)


def test_a_ball_joint_is_a_floating_one_whose_link_is_where_it_rests():
    spec = models.load("uuv_puma")
    bob = spec.body("hull").add_body(name="bob", pos=[0.1, -0.2, 0.3], quat=[0.6, 0.8, 0.0, 0.0])
    bob.add_joint(name="sling", type=mujoco.mjtJoint.mjJNT_BALL)
    bob.add_geom(size=[0.05, 0.05, 0.05], mass=1.0)
    for key in list(spec.keys):
        spec.delete(key)
    root = ElementTree.fromstring(robot_description(spec.compile()))
    joint = untyped(root.find("joint[@name='sling']"))
    assert joint.get("type") == "floating"
    origin = joint.find("origin")
    assert [float(value) for value in origin.get("xyz").split()] == [0.1, -0.2, 0.3]
    turn = Rotation.from_quat([0.6, 0.8, 0.0, 0.0], scalar_first=True).as_euler("xyz")
    assert [float(value) for value in origin.get("rpy").split()] == pytest.approx(turn)


def test_clouds_have_a_bound_together(folder, monkeypatch):
    points = sum(len(cloud) for cloud in PastRun.of(folder).clouds.values())
    assert points > 0
    monkeypatch.setattr(series_tables, "MOST_NUMBERS", 3 * points - 1)
    with pytest.raises(ConfigurationError, match="its clouds have more than"):
        _ = PastRun.of(folder).clouds


def test_a_log_of_a_run_that_goes_on_is_what_is_exported_from_it(tmp_path, monkeypatch):
    """In parts of 100 ticks; cut before its end, it has what came before."""
    monkeypatch.setattr(live_log, "_TICKS", 100)
    assembly = assemble(clean_barrel(quick=True), full=True)
    plant = assembly.plant
    recorder = Recorder(plant.model, timestep=plant.timestep, full=True)
    log = live_log.McapLog(tmp_path / "run.mcap", recorder, plant.model)
    sizes = []

    def watch(moment):
        if moment.tick % 100 == 1:
            sizes.append((moment.truth.time, (tmp_path / "run.mcap").stat().st_size))

    seen = untyped(SimpleNamespace(observe=watch, slow_ticks=(1,)))
    run_through(assembly, recorder, [log, seen], longest=1.1)
    assert sizes[-1][1] > sizes[4][1] > sizes[0][1] > 0
    shutil.copy(tmp_path / "run.mcap", tmp_path / "died.mcap")
    log.close(accepted=False)
    log.close()

    # Against the topics of the whole recording.
    types = RosTypes()
    record = recorder.recording()
    whole = {topic.name: topic for topic in RunTopics(record, {}, types=types).topics}
    logged = messages_by_topic(tmp_path / "run.mcap")
    assert set(logged) == {name for name, topic in whole.items() if len(topic.time)} | {
        "/robot_description"
    }
    for name, topic in whole.items():
        expected = [types.encoded(topic.kind, topic.message(i)) for i in range(len(topic.time))]
        encoded = [types.encoded(topic.kind, message) for _, message in logged.get(name, [])]
        if name.startswith("/odometry"):  # difference quotients round by the whole's spacing
            twists = [
                [xyz(twist.linear) + xyz(twist.angular) for twist in (m.twist.twist for m in part)]
                for part in ([m for _, m in logged[name]], map(topic.message, range(len(expected))))
            ]
            np.testing.assert_allclose(twists[0], twists[1], atol=1e-9)
            continue
        assert encoded == expected, name

    # As it was on the disk before the end: its messages but for the last part, in both readers.
    streamed = []

    def stream_all():
        with (tmp_path / "died.mcap").open("rb") as stream:
            messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
            streamed.extend((c.topic, m.log_time, bytes(m.data)) for _, c, m in messages)

    with pytest.raises(McapError):
        stream_all()
    complete = {
        (topic, stamp, types.encoded(whole[topic].kind, message))
        for topic, stamped in logged.items()
        if topic in whole
        for stamp, message in stamped
    }
    assert {row for row in streamed if row[0] in whole} <= complete
    assert max(stamp for _, stamp, _ in streamed) >= 0.9e9
    assert logs.main("logs", [str(tmp_path / "died.mcap")]) == 0


def test_parts_without_names_are_told_apart_by_their_numbers():
    spec = models.load("uuv_puma")
    for key in list(spec.keys):
        spec.delete(key)
    for side in (0.2, -0.2):
        flap = spec.body("hull").add_body(pos=[0.0, side, 0.0])
        flap.add_joint(axis=[1.0, 0.0, 0.0], limited=mujoco.mjtLimited.mjLIMITED_FALSE)
        flap.add_geom(size=[0.02, 0.02, 0.02], mass=0.01)
    model = spec.compile()
    root = ElementTree.fromstring(robot_description(model))
    for tag in ("link", "joint"):
        names = [element.get("name") for element in root.findall(tag)]
        assert all(names)
        assert len(set(names)) == len(names)
    read = mujoco.MjSpec.from_string(robot_description(model)).compile()
    assert read.njnt >= 2

    # Records, and with them /tf, call the bodies alike.
    labels = [body_label(model, body) for body in range(model.nbody)]
    assert len(set(labels)) == model.nbody
    assert {element.get("name") for element in root.findall("link")} >= set(labels[2:])


def test_a_bag_that_fails_midway_leaves_nothing_and_may_be_tried_again(tmp_path):
    types = RosTypes()

    def faulty(row):
        if row == 3:
            raise ConfigurationError("the fourth message is broken")
        return types.vector(np.zeros(3))

    kind = "geometry_msgs/msg/Vector3"
    topic = Topic("/place", kind, np.linspace(0.0, 0.4, 5), faulty)
    with pytest.raises(ConfigurationError, match="fourth message"):
        write_bag(tmp_path / "dive", [topic], types)
    assert not list(tmp_path.iterdir())

    whole = Topic("/place", kind, topic.time[:3], faulty)
    assert write_bag(tmp_path / "dive", [whole], types) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["dive"]
    assert len(messages_by_topic(tmp_path / "dive")["/place"]) == 3
