"""The ROS 2 node of the examples, without ROS: its messages against the definitions."""

import importlib.util
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

if importlib.util.find_spec("rosbags") is None:  # nor is the rest of the extra `bridge`
    pytest.skip("rosbags is not here", allow_module_level=True)

from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from uuv.serve import client
from uuv.serve.client import Packet, pack, unpack

STORE = get_typestore(Stores.ROS2_HUMBLE)


@pytest.fixture(scope="module")
def node(root: Path) -> ModuleType:
    file = root / "docs" / "examples" / "ros_node.py"
    spec = importlib.util.spec_from_file_location("ros_node", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def made(kind: str, **fields: Any) -> Any:
    """A message by its definition; numbers in a list are an array of it."""
    arrays = {
        name: np.array(value) if isinstance(value, list) and name != "name" else value
        for name, value in fields.items()
    }
    return STORE.types[kind](**arrays)


def measured(attitude: Rotation) -> Packet:
    """A measurement as it comes over the socket, in a turned pose."""
    rng = np.random.default_rng(8)
    values: dict[str, Any] = {}
    for name, size in client.MEASUREMENT.items():
        width = size if isinstance(size, int) else {"n": 4, "m": 6}[size]
        numbers = tuple(rng.normal(size=width).tolist())
        values[name] = numbers[0] if size == 1 else numbers
    values["R_WB"] = tuple(attitude.as_matrix().ravel().tolist())
    values["R_WG_set"] = tuple(Rotation.random(rng=rng).as_matrix().ravel().tolist())
    values["set_force"] = 40.0
    return unpack(pack(Packet(client.MEASURED, 4, 6, 7, 0, 0, 12.375, values)))


def test_messages_serialise_and_come_back_by_the_definitions(node: ModuleType) -> None:
    frame = measured(Rotation.from_euler("xyz", [0.3, -0.4, 2.5]))
    read = {}
    for topic, (kind, message) in node.PUBLISHED.items():
        data = STORE.serialize_cdr(message(made, frame), kind)
        read[topic] = STORE.deserialize_cdr(data, kind)

    assert (read["/clock"].clock.sec, read["/clock"].clock.nanosec) == (12, 375_000_000)
    joints = read["/joint_states"]
    assert joints.name == ["joint1", "joint2", "joint3", "joint4"]
    assert (tuple(joints.position), tuple(joints.effort)) == (frame.q, frame.tau)
    assert tuple(joints.velocity) == frame.qd

    place = read["/odometry"]
    assert (place.header.frame_id, place.child_frame_id) == ("world", "hull")
    assert place.twist.twist.linear.y == frame.v_WB_B[1]
    assert place.pose.covariance[7] == pytest.approx(frame.position_sigma[1] ** 2)
    wrench = read["/tool/wrench/set"].wrench
    axis = np.array(frame.R_WG_set).reshape(3, 3)[:, 2]
    np.testing.assert_allclose([wrench.force.x, wrench.force.y, wrench.force.z], 40.0 * axis)


@pytest.mark.parametrize("angles", [(0.1, 0.2, 0.3), (3.1, 0.1, 0.2), (0.0, 3.1, 0.1), (0, 0, 3.1)])
def test_the_attitude_is_that_of_the_matrix(node: ModuleType, angles: tuple[float, ...]) -> None:
    attitude = Rotation.from_euler("xyz", angles)
    quat = np.array(node.quaternion(measured(attitude).R_WB))
    assert abs(quat @ attitude.as_quat()) == pytest.approx(1.0, abs=1e-12)


def test_commands_are_the_newest_ones_and_wrong_ones_are_said(node: ModuleType) -> None:
    frame = measured(Rotation.identity())
    commands = node.Commands()
    assert commands.of("/effort_command", frame) == ([0.0] * 4, "")
    commands.take("/effort_command", [1, 2, 3, 4])
    assert commands.of("/effort_command", frame) == ([1.0, 2.0, 3.0, 4.0], "")
    commands.take("/thruster_command", [0.5])
    values, reason = commands.of("/thruster_command", frame)
    assert values == [0.0] * 6
    assert reason == "/thruster_command: needs 6 finite numbers, got [0.5]"
    commands.take("/thruster_command", [math.nan] * 6)
    assert commands.of("/thruster_command", frame)[1].startswith("/thruster_command: needs 6")
