"""What goes through the door: a briefing, estimates and set points to the entry, commands as plain numbers back.

Messages to the entry are pickled, for the simulation made them. Replies of the entry are never unpickled: a reply is a
letter, then text or numbers of fixed count.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from scenarios.scenario import Control
from sim.interfaces.errors import UuvError
from sim.interfaces.messages import Command, ContactEstimate, HullLoad
from sim.interfaces.spatial import Array

READY, COMMAND, FAILED = b"R", b"C", b"F"  # first letter of a reply
_NO_LOAD, _SAME_LOAD, _NEW_LOAD = 0.0, 1.0, 2.0
_REST = 2 + 7 + 1 + 9  # numbers beside torques and thrusters


class EntryError(UuvError):
    """An entry crashed, did not answer in time, or answered what is no command."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Briefing:
    """What an entry is told before the work begins."""

    model: mujoco.MjModel  # the vehicle as it is believed; the object is not in it
    water_error: float  # [-] share by which the controller's coefficients are to be wrong
    control: Control  # the entry: name or MODULE:CLASS, and methods replaced
    task: str  # name of the family of jobs
    seed: int  # for the entry's own random numbers; tells nothing about the case


class CommandCodec:
    """Commands of one vehicle as bytes and back; log entries (`Command.believed`) and faults are left out."""

    def __init__(self, joints: int, thrusters: int) -> None:
        self._joints, self._thrusters = joints, thrusters
        self._sent: HullLoad | None = None
        self._got: HullLoad | None = None

    def encode(self, command: Command) -> bytes:
        """The command as bytes.

        Raises:
            TypeError: It is no command, or has arrays of another size.
        """
        if not isinstance(command, Command):
            raise TypeError(f"step gave {type(command).__name__} in place of a Command")
        for name, size in (("joint_torque", self._joints), ("thrusters", self._thrusters)):
            if np.shape(getattr(command, name)) != (size,):
                raise TypeError(f"{name}: expected shape ({size},), got {np.shape(getattr(command, name))}")
        load, contact = command.hull_load, command.contact
        kind = _NO_LOAD if load is None else _SAME_LOAD if load is self._sent else _NEW_LOAD
        self._sent = load
        numbers = np.concatenate(
            [
                [command.time, float(command.scan)],
                command.joint_torque,
                command.thrusters,
                contact.force_W,
                [contact.normal],
                contact.sigma_G,
                [kind],
                np.zeros(9) if load is None else np.concatenate([load.arm_wrench_B, load.current_W]),
            ]
        )
        return COMMAND + np.asarray(numbers, dtype=np.float64).tobytes()

    def decode(self, reply: bytes, time: float) -> Command:
        """The command in a reply to an estimate of that time [s].

        Raises:
            EntryError: The reply is no command, or one for another time.
        """
        n, m = self._joints, self._thrusters
        if reply[:1] != COMMAND or len(reply) != 1 + 8 * (_REST + n + m):
            raise EntryError("the entry answered what is no command")
        numbers: Array = np.frombuffer(reply, dtype=np.float64, offset=1)
        if numbers[0] != time:
            raise EntryError(f"the entry's command is of {numbers[0]:g} s; asked was one of {time:g} s")
        head, torque, thrusters, contact, load = np.split(numbers, np.cumsum([2, n, m, 7]))
        if load[0] == _NEW_LOAD:
            self._got = HullLoad(arm_wrench_B=load[1:7], current_W=load[7:])
        elif load[0] == _NO_LOAD:
            self._got = None
        elif load[0] != _SAME_LOAD or self._got is None:
            raise EntryError("the entry answered what is no command")
        return Command(
            time=time,
            joint_torque=torque,
            thrusters=thrusters,
            scan=bool(head[1] == 1.0),
            contact=ContactEstimate(force_W=contact[:3], normal=float(contact[3]), sigma_G=contact[4:]),
            hull_load=self._got,
        )
