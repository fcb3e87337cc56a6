"""Messages between simulation and entry: briefing, estimates and set points to the entry, commands
back.

A message to the entry at a tick is the estimate as plain numbers, followed by the pickled set
points if they are new. An entry with its own estimator first gets the pickled measurements, and
sends the estimate as plain numbers. Replies of the entry are never unpickled. A reply is a letter,
followed by text or by a fixed number of numbers.
"""

import pickle
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from uuv.scenario import Control
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.messages import Command, ContactEstimate, HullLoad, Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array, checked_pose

READY, COMMAND, ESTIMATE, FAILED = b"R", b"C", b"S", b"F"  # first letter of a reply
# digests of the files that the entry has loaded, in JSON, sent before the reply to its briefing
LOADED = b"L"
# first letter of a message that is pickled
START_ESTIMATOR, START_CONTROLLER, MEASURED = b"I", b"J", b"M"
_NO_LOAD, _SAME_LOAD, _NEW_LOAD = 0.0, 1.0, 2.0
_REST = 2 + 7 + 1 + 9  # number of entries besides torques and thrusters
# first letter of a message: an estimate as numbers, or one that includes rarely used fields
_PLAIN, _PICKLED = b"E", b"P"
# Fields of an estimate in order, with shapes for those that are not per joint.
_FIELDS: dict[str, tuple[int, ...]] = {
    "X_WB": (4, 4),
    "v_WB_B": (3,),
    "w_WB_B": (3,),
    "a_WB_B": (3,),
    "position_sigma": (3,),
    "object_moved_W": (3,),
    "gyro_off_B": (3,),
    "attitude_off_B": (3,),
    "q": (),
    "qd": (),
    "tau": (),
}
_NUMBERS = ("time", "attitude_sigma", "vision_age", "dvl_age", "imu_age", "imu_jump_age")


class EntryError(UuvError):
    """An entry crashed, did not reply in time, or its reply is not a command."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Briefing:
    """Information that an entry gets before the work begins."""

    model: mujoco.MjModel  # believed model of the vehicle; the object is not in it
    water_error: float  # [-] share by which the controller's coefficients are made wrong
    control: Control  # name or MODULE:CLASS of the entry, and methods that are replaced
    # MODULE:CLASS of the entry's estimator; empty: navigation runs in the simulation
    estimator: str
    task: str  # name of the family of jobs
    # seed for the entry's own random numbers; equal in all cases, so that it does not identify a
    # case
    seed: int


class EstimateCodec:
    """Conversion of estimates of one vehicle, with set points if they are new, to bytes and
    back.
    """

    def __init__(self, joints: int) -> None:
        shapes = {name: shape or (joints,) for name, shape in _FIELDS.items()}
        ends = len(_NUMBERS) + np.cumsum([np.prod(shape, dtype=int) for shape in shapes.values()])

        self._numbers = np.zeros(ends[-1])  # parts of the message that is being made
        starts = (len(_NUMBERS), *ends[:-1].tolist())
        self._parts = [
            (name, slice(start, end), shape)
            for (name, shape), start, end in zip(shapes.items(), starts, ends.tolist(), strict=True)
        ]
        self._size = 1 + self._numbers.nbytes

    def encode(self, estimate: StateEstimate, reference: Reference | None) -> bytes:
        """The message of a tick.

        Args:
            estimate: Estimate of the tick.
            reference: New set points; None: those of the last message.
        """
        rare = estimate.tau_doubt, estimate.ground, estimate.jaws
        if any(part is not None for part in rare):
            return _PICKLED + pickle.dumps((estimate, reference), pickle.HIGHEST_PROTOCOL)
        more = b"" if reference is None else pickle.dumps(reference, pickle.HIGHEST_PROTOCOL)
        return _PLAIN + self._packed(estimate) + more

    def decode(self, message: bytes) -> tuple[StateEstimate, Reference | None]:
        """The estimate of a message, in new arrays, and its set points; None if there are no new
        ones.
        """
        if message[:1] == _PICKLED:
            return pickle.loads(message[1:])
        more = message[self._size :]
        return self._unpacked(message[1 : self._size]), pickle.loads(more) if more else None

    def encode_reply(self, estimate: StateEstimate) -> bytes:
        """The reply of an entry's estimator; `tau_doubt`, `ground` and `jaws` are left out.

        Raises:
            TypeError: `estimate` is not an estimate, or has arrays of another size.
        """
        if not isinstance(estimate, StateEstimate):
            raise TypeError(f"step: must return a StateEstimate, got {type(estimate).__name__}")

        for name, _, shape in self._parts:
            if np.shape(getattr(estimate, name)) != shape:
                raise TypeError(
                    f"{name}: expected shape {shape}, got {np.shape(getattr(estimate, name))}"
                )

        return ESTIMATE + self._packed(estimate)

    def decode_reply(self, reply: bytes) -> StateEstimate:
        """The estimate in a reply.

        Raises:
            EntryError: The reply is not an estimate, or its `X_WB` is not a pose.
        """
        if reply[:1] != ESTIMATE or len(reply) != self._size:
            raise EntryError("the reply of the entry is not an estimate")
        estimate = self._unpacked(reply[1:])

        try:
            checked_pose(estimate.X_WB, "X_WB of the entry's estimate")
        except ConfigurationError as error:
            raise EntryError(str(error)) from error

        return estimate

    def _packed(self, estimate: StateEstimate) -> bytes:
        numbers = self._numbers
        numbers[: len(_NUMBERS)] = [getattr(estimate, name) for name in _NUMBERS]
        for name, part, _ in self._parts:
            numbers[part] = np.ravel(getattr(estimate, name))
        return numbers.tobytes()

    def _unpacked(self, packed: bytes) -> StateEstimate:
        numbers = np.frombuffer(packed).copy()
        decoded: dict[str, Any] = dict(
            zip(_NUMBERS, numbers[: len(_NUMBERS)].tolist(), strict=True)
        )
        decoded |= {name: numbers[part].reshape(shape) for name, part, shape in self._parts}
        return StateEstimate(**decoded)


class CommandCodec:
    """Conversion of commands of one vehicle to bytes and back, without log entries (`believed`) and
    faults.
    """

    def __init__(self, joints: int, thrusters: int) -> None:
        self._joints, self._thrusters = joints, thrusters
        self._sent: HullLoad | None = None
        self._got: HullLoad | None = None
        # parts of the reply that is being made
        self._numbers = np.zeros(_REST + joints + thrusters)

    def encode(self, command: Command) -> bytes:
        """The command as bytes.

        Raises:
            TypeError: `command` is not a command, or has arrays of another size.
        """
        if not isinstance(command, Command):
            raise TypeError(f"step: must return a Command, got {type(command).__name__}")

        for name, size in (("joint_torque", self._joints), ("thrusters", self._thrusters)):
            if np.shape(getattr(command, name)) != (size,):
                raise TypeError(
                    f"{name}: expected shape ({size},), got {np.shape(getattr(command, name))}"
                )

        load = command.hull_load
        contact = command.contact
        numbers = self._numbers
        kind = _NO_LOAD if load is None else _SAME_LOAD if load is self._sent else _NEW_LOAD
        self._sent = load

        n, m = 2 + self._joints, 2 + self._joints + self._thrusters
        numbers[:2] = command.time, float(command.scan)
        numbers[2:n] = command.joint_torque
        numbers[n:m] = command.thrusters
        numbers[m : m + 3] = contact.force_W
        numbers[m + 3] = contact.normal
        numbers[m + 4 : m + 7] = contact.sigma_G

        numbers[m + 7] = kind
        if kind == _NEW_LOAD and load is not None:
            numbers[m + 8 : m + 14] = load.arm_wrench_B
            numbers[m + 14 :] = load.current_W
        return COMMAND + numbers.tobytes()

    def decode(self, reply: bytes, time: float) -> Command:
        """The command in a reply to an estimate of that time [s].

        Raises:
            EntryError: The reply is not a command, or a command for another time.
        """
        n, m = self._joints, self._thrusters
        if reply[:1] != COMMAND or len(reply) != 1 + 8 * (_REST + n + m):
            raise EntryError("the reply of the entry is not a command")

        numbers: Array = np.frombuffer(reply[1:]).copy()
        if numbers[0] != time:
            raise EntryError(
                f"the entry's command must be for the time {time:g} s, got one for {numbers[0]:g} s"
            )

        torque, thrusters = numbers[2 : 2 + n], numbers[2 + n : 2 + n + m]
        contact, load = numbers[2 + n + m : 9 + n + m], numbers[9 + n + m :]

        if load[0] == _NEW_LOAD:
            self._got = HullLoad(arm_wrench_B=load[1:7], current_W=load[7:])
        elif load[0] == _NO_LOAD:
            self._got = None
        elif load[0] != _SAME_LOAD or self._got is None:
            raise EntryError("the reply of the entry is not a command")

        return Command(
            time=time,
            joint_torque=torque,
            thrusters=thrusters,
            scan=bool(numbers[1] == 1.0),
            contact=ContactEstimate(
                force_W=contact[:3], normal=float(contact[3]), sigma_G=contact[4:]
            ),
            hull_load=self._got,
        )
