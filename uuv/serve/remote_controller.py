"""A controller in another process, asked over UDP at each of its ticks.

In lockstep the simulation waits for each answer. In paced mode it goes on with the last command,
for at most `HELD` of simulated time. Without an answer for longer the command is not a number, and
the safety wrapper departs with the tool as it does when a controller fails.
"""

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

import numpy as np

from uuv.models.vehicle import Vehicle
from uuv.pace import WallClock
from uuv.serve import client
from uuv.serve.client import Packet, PacketError
from uuv.serve.late_commands import Answer, Asked, LateCommands
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    ContactEstimate,
    HullLoad,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array

HELD = 0.2  # [s] simulated, for which a command holds
LARGEST = 1e6  # magnitude of a command's numbers, in their units
PATIENCE = 10.0  # [s] on the wall that an answer is waited for in lockstep
GREETING = 300.0  # [s] on the wall that a client is waited for at first
_SILENCE = 1.0  # [s] on the wall, of the client, after which another may take over
_AT_ONCE = 64  # datagrams that are taken after a tick is due
_GRANTED = 0.5  # share of a period that the client has if the run is behind
_AGAIN = 0.1  # [s] on the wall after which a frame is sent again
_REASONS = 8  # reasons of refusals that are told while a client is waited for
_STATES = tuple(WorkState)


@dataclass(slots=True)
class Exchange:
    """What went out and came in."""

    sent: int = 0
    again: int = 0  # frames that were sent again for want of an answer
    taken: int = 0  # commands
    stale: int = 0  # commands that came twice, or after a newer one
    refused: int = 0  # datagrams that are no command for this vehicle
    held: int = 0  # ticks that went on with an earlier command
    silent: int = 0  # ticks without a command that still holds
    oldest_s: float = 0.0  # [s] simulated, largest age of a command that was used
    reason: str = ""  # why a datagram was refused, the last time

    def summary(self) -> str:
        """In one line."""
        counts = {name: value for name, value in asdict(self).items() if name != "reason"}
        line = ", ".join(f"{value:g} {name}" for name, value in counts.items())
        return f"{line}; last refused: {self.reason}" if self.reason else line


class FrameLink(Protocol):
    """Where frames go out and come in, such as an `uuv.serve.datagrams.Endpoint`."""

    @property
    def port(self) -> int:
        """Number in messages."""
        ...

    @property
    def peer(self) -> tuple[str, int] | None:
        """Client that is answered; None: none yet."""
        ...

    def receive(self, patience: float = ...) -> bytes | None:
        """Next datagram; None: none within `patience` [s]."""
        ...

    def send(self, data: bytes) -> bool:
        """Send to the client; False: there is none, or no way there."""
        ...

    def answer_there(self) -> None:
        """Answer from now on to where the last datagram came from."""
        ...

    def interrupts(self, silence: float) -> bool:
        """Whether the last datagram is of another client, while the first is not silent for
        `silence` [s].
        """
        ...


class UdpController:
    """Controller whose answers come from a client (`uuv.sim.interfaces.protocols.Controller`)."""

    def __init__(
        self, endpoint: FrameLink, vehicle: Vehicle, *, period: float, pace: WallClock | None = None
    ) -> None:
        """Serve a vehicle's estimates at a socket.

        Args:
            endpoint: Bound socket, or a link of another kind.
            vehicle: The vehicle as it is believed.
            period: [s] between commands.
            pace: Real-time pacing of the run; None: lockstep.
        """
        self.period = period
        self.traffic = Exchange()
        self._endpoint = endpoint
        self._joints = len(vehicle.joints)
        self._thrusters = len(vehicle.thruster_names)
        self._drives = LateCommands(vehicle, period)
        self._pace = pace
        self._count = 0
        self._answered = -1  # count of the newest command
        self._sent: dict[int, Asked] = {}  # by the count of a frame
        self._answer: Answer | None = None  # newest command
        # (n,) [N m] torques of the last period, and the age [s] of the command that they are of
        self._applied = np.zeros(self._joints)
        self._link_age = math.nan
        self._reference: Reference | None = None  # last one that was sent
        self._since = 0  # count from which it was
        self._gone = False

    def init(self, estimate: StateEstimate) -> None:
        """Wait for a client, and show it the first estimate with set points that hold it.

        Raises:
            ConfigurationError: None came, or it does not answer.
        """
        await_client(self._endpoint)
        held = Reference.holding(estimate.time, estimate.X_WB, estimate.q)
        self._ask(self._measured(estimate, held, client.START), GREETING)
        if self._answered < self._count:
            raise ConfigurationError(
                f"port {self._endpoint.port}: the client sends no command within {GREETING:.0f} s"
            )
        self._answer = None

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        """The client's command for an estimate, or the last one while it holds."""
        if self._gone:
            return state, self._none(estimate, reference)

        # Out with the measurement, in with what answers it.
        self._drives.measure(self._applied, estimate)
        self._count += 1
        if reference is not self._reference:
            self._since = self._count
        self._reference = reference
        frame = self._measured(estimate, reference)
        if self._pace is None:
            self._ask(frame, PATIENCE)
        elif self._answer is None and not self.traffic.silent:
            self._ask(frame, GREETING)  # time begins when the client is ready
            self._pace.arrive(estimate.time, reference.state)
        else:
            self._pace.arrive(estimate.time, reference.state)
            self._send(frame)
            self._listen_until(self._pace.due(estimate.time + self.period))

        # The newest command, if it still holds.
        answer = self._answer
        age = math.inf if answer is None else estimate.time - answer.asked.time
        if answer is None or age > HELD or (self._pace is None and self._answered < self._count):
            self.traffic.silent += 1
            self._gone = self._pace is None
            self._link_age = age
            return state, self._none(estimate, reference)

        self.traffic.held += self._answered < self._count
        self.traffic.oldest_s = max(self.traffic.oldest_s, age)
        command = answer.command
        if age > 0.0:
            torque = self._drives.torque(answer, estimate)
            command = replace(command, time=estimate.time, joint_torque=torque, scan=reference.scan)
        self._applied = command.joint_torque
        self._link_age = age
        return state, command

    def close(self) -> None:
        """Tell the client that the run has ended."""
        header = (client.VERSION, self._joints, self._thrusters, self._count, 0, 0, 0.0)
        self._endpoint.send(client.HEADER.pack(client.ENDED, *header))

    def _ask(self, frame: bytes, patience: float) -> None:
        """Send a frame until it is answered, for `patience` [s]."""
        end = time.monotonic() + patience
        self._send(frame)

        while self._answered < self._count and (left := end - time.monotonic()) > 0.0:
            datagram = self._endpoint.receive(min(_AGAIN, left))
            if datagram is not None:
                self._take(datagram)
            else:
                self.traffic.again += 1
                self._endpoint.send(frame)

    def _listen_until(self, due: float) -> None:
        """Take what arrives until a time [s] on the pace's clock; at least what is there.

        A run that is behind still waits for the answer, for a share of the period: it is the
        simulation that is late then, and not the client.
        """
        assert self._pace is not None
        latest = self._pace.clock() + _GRANTED * self.period / self._pace.factor
        left = _AT_ONCE
        while True:
            end = due if self._answered == self._count else max(due, latest)
            wait = end - self._pace.clock()
            datagram = self._endpoint.receive(max(wait, 0.0))
            if datagram is not None:
                self._take(datagram)

            # A flood of datagrams does not hold up the run.
            left -= wait <= 0.0
            if wait <= 0.0 and (datagram is None or left == 0):
                return

    def _send(self, frame: bytes) -> None:
        self.traffic.sent += 1
        self._endpoint.send(frame)

    def _take(self, data: bytes) -> None:
        """Take a datagram as a command, if it is one that is newer than the last."""
        try:
            if self._endpoint.interrupts(_SILENCE):
                raise PacketError("a second client, while the first one answers")
            frame = client.unpack(data)
            self._check(frame)
        except PacketError as error:
            self.traffic.refused += 1
            self.traffic.reason = str(error)
            return

        self._endpoint.answer_there()  # a client that comes again may have another port
        if frame.kind == client.ENDED:  # a greeting
            return

        # Its age is that of the measurement, whatever the client says.
        asked = self._sent.get(frame.count)
        if asked is None or frame.count <= self._answered:
            self.traffic.stale += 1
            return

        # What nobody can mean is no command, as if it were not a number.
        if beyond := _beyond(frame):
            self.traffic.reason = beyond
            no_number = (math.nan,) * self._joints
            frame = replace(frame, values=frame.values | {"joint_torque": no_number})

        self._answered = frame.count
        self._answer = self._of_frame(frame, asked)
        self._sent = {count: asked for count, asked in self._sent.items() if count > frame.count}
        self.traffic.taken += 1

    def _check(self, frame: Packet) -> None:
        """Raise PacketError if a frame is neither a greeting nor a command for this vehicle."""
        sizes = (frame.joints, frame.thrusters)
        if frame.kind == client.MEASURED:
            raise PacketError("a frame with a measurement comes from the simulation alone")
        if frame.kind == client.COMMANDED and sizes != (self._joints, self._thrusters):
            raise PacketError(
                f"a command for {sizes[0]} joints and {sizes[1]} thrusters, the vehicle has "
                f"{self._joints} and {self._thrusters}"
            )

    def _of_frame(self, frame: Packet, asked: Asked) -> Answer:
        """A command as the loop has it, for the motion of the joints that it answers."""
        values = frame.values
        command = Command(
            time=asked.time,
            joint_torque=self._drives.cut(np.array(values["joint_torque"])),
            thrusters=np.clip(np.array(values["thrusters"]), -1.0, 1.0),
            scan=frame.flag(client.SCAN),
            contact=ContactEstimate(
                force_W=np.array(values["force_W"]),
                normal=values["normal"],
                sigma_G=np.array(values["sigma_G"]),
            ),
            hull_load=self._load_of(values),
        )

        def rows(name: str) -> Array:
            return np.reshape(values[name], (self._joints, -1))

        return Answer(
            command=command,
            asked=asked,
            stiffness=rows("stiffness"),
            damping=rows("damping"),
            compensation=rows("compensation"),
            friction=np.array(values["gear_friction"]),
        )

    def _load_of(self, values: dict[str, Any]) -> HullLoad | None:
        """Loads on the hull; the last object where nothing changed, as between two hull steps."""
        wrench = np.array(values["arm_wrench_B"])
        current = np.array(values["current_W"])
        if not (np.isfinite(wrench).all() and np.isfinite(current).all()):
            return None

        last = None if self._answer is None else self._answer.command.hull_load
        same = (
            last is not None
            and np.array_equal(last.arm_wrench_B, wrench)
            and np.array_equal(last.current_W, current)
        )
        return last if same else HullLoad(arm_wrench_B=wrench, current_W=current)

    def _measured(self, estimate: StateEstimate, reference: Reference, flags: int = 0) -> bytes:
        """Estimate and set points as a frame."""
        for mask, is_set in (
            (client.SCAN, reference.scan),
            (client.FORCE_CONTROL, reference.force_control),
            (client.TARE, reference.tare),
            (client.COMPLIANT, reference.compliant),
            (client.STANDING, reference.standing),
            (client.FRESH, self._answered < self._since),  # until the client has had them
        ):
            flags |= mask if is_set else 0

        # The estimate.
        values: dict[str, Any] = _pose("WB", estimate.X_WB)
        for name in ("vision_age", "dvl_age", "imu_age", "imu_jump_age", "attitude_sigma"):
            values[name] = getattr(estimate, name)
        for name in (
            *("v_WB_B", "w_WB_B", "a_WB_B", "position_sigma", "q", "qd", "tau"),
            *("object_moved_W", "gyro_off_B", "attitude_off_B"),
        ):
            values[name] = getattr(estimate, name).tolist()
        values["link_age"] = self._link_age
        values["applied_torque"] = self._applied.tolist()
        doubt = estimate.tau_doubt
        values["tau_doubt"] = self._joints * [math.nan] if doubt is None else doubt.tolist()

        # The set points.
        values |= {
            "set_time": reference.time,
            "state": _STATES.index(reference.state),
            **{f"{name}_set": value for name, value in _pose("WB", reference.X_WB).items()},
            **{f"{name}_set": value for name, value in _pose("WG", reference.X_WG).items()},
            "v_WB_set": reference.v_WB_W.tolist(),
            "w_WB_set": reference.w_WB_W.tolist(),
            "v_WG_set": reference.v_WG_W.tolist(),
            "w_WG_set": reference.w_WG_W.tolist(),
            "q_set": reference.q.tolist(),
            "qd_set": reference.qd.tolist(),
            "set_force": reference.set_force,
            "path_s": reference.path_s,
            "lost_thrust": self._lost_thrust(reference),
        }

        self._remember(estimate)
        lost = sum(1 << thruster for thruster in reference.lost_thrusters)
        sizes = (self._joints, self._thrusters)
        return client.pack(
            Packet(client.MEASURED, *sizes, self._count, flags, lost, estimate.time, values)
        )

    def _remember(self, estimate: StateEstimate) -> None:
        """Keep what a command that answers this frame was computed for, while it could hold."""
        oldest = next(iter(self._sent.values()), None)
        if oldest is not None and estimate.time - oldest.time > HELD:
            del self._sent[next(iter(self._sent))]
        self._sent[self._count] = Asked.of(estimate)

    def _lost_thrust(self, reference: Reference) -> list[float]:
        """Thrust [N] that each thruster gives although it is not to be used."""
        thrusts = self._thrusters * [0.0]
        for thruster, thrust in zip(reference.lost_thrusters, reference.lost_thrust, strict=False):
            thrusts[thruster] = thrust
        return thrusts

    def _none(self, estimate: StateEstimate, reference: Reference) -> Command:
        """A command that is not a number."""
        return Command(
            time=estimate.time,
            joint_torque=np.full(self._joints, np.nan),
            thrusters=np.full(self._thrusters, np.nan),
            scan=reference.scan,
        )


def await_client(
    endpoint: FrameLink, patience: float = GREETING, *, refused: Callable[[str], None] | None = None
) -> None:
    """Wait for the first frame of a client; what is none does not count.

    Args:
        endpoint: Bound socket.
        patience: [s] on the wall.
        refused: Takes why a datagram is no such frame, each reason once.

    Raises:
        ConfigurationError: None came in time.
    """
    end = time.monotonic() + patience
    reasons: set[str] = set()
    while endpoint.peer is None:
        datagram = endpoint.receive()
        try:
            if datagram is not None and client.unpack(datagram).kind != client.MEASURED:
                endpoint.answer_there()
        except PacketError as error:
            reason = str(error)
            if refused is not None and reason not in reasons and len(reasons) < _REASONS:
                refused(reason)
                reasons.add(reason)

        if time.monotonic() > end:
            raise ConfigurationError(f"port {endpoint.port}: no client within {patience:.0f} s")


def _beyond(frame: Packet) -> str:
    """Quantity of a command with a finite number that nobody can mean; empty: none."""
    for name, value in frame.values.items():
        for number in value if isinstance(value, tuple) else (value,):
            if LARGEST < abs(number) < math.inf:
                return f"{name}: must be within +-{LARGEST:g}, got {number:g}"
    return ""


def _pose(name: str, X: Array | None) -> dict[str, list[float]]:
    """Position and rotation, row by row, of a pose (4, 4); NaN where there is none."""
    if X is None:
        return {f"p_{name}": 3 * [math.nan], f"R_{name}": 9 * [math.nan]}
    return {f"p_{name}": X[:3, 3].tolist(), f"R_{name}": X[:3, :3].ravel().tolist()}
