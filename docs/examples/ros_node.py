"""ROS 2 node between `uuv serve udp` and a controller in ROS: states out, commands in.

    uuv serve udp open-water --rate 100 --pace 1    # the simulation, in real time
    python3 ros_node.py                             # in an environment of ROS 2; --port, --host

It publishes /clock, /joint_states, /odometry and /tool/wrench/set, and takes
/effort_command [N m] and /thruster_command [-1, 1] as std_msgs/Float64MultiArray. A measurement is
answered by the newest commands; those that are older than 0.2 s count as none.
`client.py` beside it is a copy of `uuv/serve/client.py`, which has no dependencies.
"""

import argparse
import math
import threading
import time
from typing import Any

LATEST = 0.2  # [s] of wall time after which a command counts as none
WORLD, HULL = "world", "hull"


def stamp(make: Any, seconds: float) -> Any:
    """Simulated time as a builtin_interfaces/Time; `make(kind, **fields)` makes a message."""
    whole, rest = divmod(round(1e9 * seconds), 10**9)
    return make("builtin_interfaces/msg/Time", sec=whole, nanosec=rest)


def header(make: Any, seconds: float, frame: str) -> Any:
    """Header with a time and the name of a frame."""
    return make("std_msgs/msg/Header", stamp=stamp(make, seconds), frame_id=frame)


def quaternion(R: tuple[float, ...]) -> tuple[float, float, float, float]:
    """x, y, z, w of a rotation matrix by rows, from its largest component."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = R

    # Four times the square of each component; the largest is divided by.
    squares = (1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz, 1 + xx + yy + zz)
    largest = max(range(4), key=lambda i: squares[i])
    rows = (
        (squares[0], xy + yx, xz + zx, zy - yz),
        (xy + yx, squares[1], yz + zy, xz - zx),
        (xz + zx, yz + zy, squares[2], yx - xy),
        (zy - yz, xz - zx, yx - xy, squares[3]),
    )

    scale = 2.0 * math.sqrt(squares[largest])
    x, y, z, w = (entry / scale for entry in rows[largest])
    return x, y, z, w


def vector(make: Any, kind: str, xyz: tuple[float, ...]) -> Any:
    """A geometry_msgs Vector3 or Point."""
    return make(f"geometry_msgs/msg/{kind}", **dict(zip("xyz", xyz, strict=True)))


def clock(make: Any, frame: Any) -> Any:
    """Simulated time."""
    return make("rosgraph_msgs/msg/Clock", clock=stamp(make, frame.time))


def joint_states(make: Any, frame: Any) -> Any:
    """Measured joint angles, speeds and torques."""
    return make(
        "sensor_msgs/msg/JointState",
        header=header(make, frame.time, ""),
        name=[f"joint{i}" for i in range(1, frame.joints + 1)],
        position=list(frame.q),
        velocity=list(frame.qd),
        effort=list(frame.tau),
    )


def odometry(make: Any, frame: Any) -> Any:
    """Estimated pose of the hull in the world, and its twist in hull axes."""
    # Pose of the hull, and its standard deviations.
    x, y, z, w = quaternion(frame.R_WB)
    orientation = make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    position = vector(make, "Point", frame.p_WB)
    pose = make("geometry_msgs/msg/Pose", position=position, orientation=orientation)

    covariance = [0.0] * 36
    for axis, sigma in enumerate((*frame.position_sigma, *(3 * (frame.attitude_sigma,)))):
        covariance[7 * axis] = sigma**2

    # Twist in hull axes, of which the deviations are not sent.
    twist = make(
        "geometry_msgs/msg/Twist",
        linear=vector(make, "Vector3", frame.v_WB_B),
        angular=vector(make, "Vector3", frame.w_WB_B),
    )
    return make(
        "nav_msgs/msg/Odometry",
        header=header(make, frame.time, WORLD),
        child_frame_id=HULL,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=covariance),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=[0.0] * 36),
    )


def set_wrench(make: Any, frame: Any) -> Any:
    """Force that the task sets, of the tool on the object, along the set tool axis, world axes."""
    axis = frame.R_WG_set[2::3]

    force = tuple(0.0 if math.isnan(part) else frame.set_force * part for part in axis)
    wrench = make(
        "geometry_msgs/msg/Wrench",
        force=vector(make, "Vector3", force),
        torque=vector(make, "Vector3", (0.0, 0.0, 0.0)),
    )
    stamped = header(make, frame.time, WORLD)
    return make("geometry_msgs/msg/WrenchStamped", header=stamped, wrench=wrench)


PUBLISHED = {
    "/clock": ("rosgraph_msgs/msg/Clock", clock),
    "/joint_states": ("sensor_msgs/msg/JointState", joint_states),
    "/odometry": ("nav_msgs/msg/Odometry", odometry),
    "/tool/wrench/set": ("geometry_msgs/msg/WrenchStamped", set_wrench),
}
TAKEN = {"/effort_command": "joints", "/thruster_command": "thrusters"}


class Commands:
    """Newest command of each kind; a wrong one is left out, with a reason."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[float, list[float]]] = {}

    def take(self, topic: str, values: Any) -> None:
        """Keep what came on a topic."""
        self._newest[topic] = time.monotonic(), [float(value) for value in values]

    def of(self, topic: str, frame: Any) -> tuple[list[float], str]:
        """Values for a measurement, zeros without a command; and why one was left out, or ''."""
        count = getattr(frame, TAKEN[topic])

        # The newest one, if it is not too old.
        heard, values = self._newest.get(topic, (-math.inf, []))
        if time.monotonic() - heard > LATEST:
            return [0.0] * count, ""

        if len(values) != count or not all(map(math.isfinite, values)):
            return [0.0] * count, f"{topic}: needs {count} finite numbers, got {values}"
        return values, ""


def ros_message(kind: str, **fields: Any) -> Any:
    """A message of ROS by the name of its type, as it is here."""
    from importlib import import_module

    package, _, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)(**fields)


def main() -> None:
    """Run the node until the simulation ends."""
    import rclpy
    from client import Client
    from rclpy.utilities import remove_ros_args
    from std_msgs.msg import Float64MultiArray

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=9010)
    options = parser.parse_args(remove_ros_args()[1:])

    # Topics out and in.
    rclpy.init()
    node = rclpy.create_node("uuv")
    commands = Commands()
    publishers = {
        topic: node.create_publisher(type(ros_message(kind)), topic, 10)
        for topic, (kind, _) in PUBLISHED.items()
    }

    for topic in TAKEN:
        node.create_subscription(
            Float64MultiArray, topic, lambda m, topic=topic: commands.take(topic, m.data), 10
        )

    # Commands arrive beside the loop, which the simulation leads.
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    try:
        with Client(options.host, options.port) as vehicle:
            for frame in vehicle:
                for topic, (_, message) in PUBLISHED.items():
                    publishers[topic].publish(message(ros_message, frame))

                # The answer: the newest commands.
                effort, wrong = commands.of("/effort_command", frame)
                thrust, also = commands.of("/thruster_command", frame)

                for reason in filter(None, (wrong, also)):
                    node.get_logger().warning(reason, throttle_duration_sec=1.0)
                vehicle.send(frame, joint_torque=effort, thrusters=thrust)
    except TimeoutError as error:
        node.get_logger().error(str(error))
    finally:
        rclpy.shutdown()


if __name__ == "__main__":
    main()
