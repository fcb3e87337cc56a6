"""Process of an entry: makes the controller from its briefing, and replies to estimates with
commands.

An entry with an estimator also replies to measurements with an estimate. `uuv.benchmark.door`
starts the process, which contains no simulation. Its one argument is the number of its socket.
"""

import json
import pickle
import sys
from multiprocessing.connection import Connection
from typing import Any

from uuv.benchmark.wire import (
    FAILED,
    LOADED,
    MEASURED,
    READY,
    START_CONTROLLER,
    START_ESTIMATOR,
    Briefing,
    CommandCodec,
    EstimateCodec,
)
from uuv.components.contact_parts import controller, estimator
from uuv.experiment.loaded_code import new_digests
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import one_line
from uuv.sim.interfaces.messages import Reference


def main() -> None:
    """Serve until the simulation closes the connection; an error ends the process with one line."""
    connection = Connection(int(sys.argv[1]))
    try:
        serve(connection)
    except EOFError:
        return
    except Exception as error:
        _tell_code(connection)
        connection.send_bytes(FAILED + f"{type(error).__name__}: {one_line(str(error))}".encode())


def serve(connection: Connection) -> None:
    """Reply to messages until the connection is closed.

    Raises:
        EOFError: The simulation closed the connection.
        Exception: An exception of the entry.
    """
    briefing: Briefing = connection.recv()
    wrapped: Any = controller(briefing.control, briefing.model, water_error=briefing.water_error)
    entry = wrapped.controller  # the safety wrapper itself runs in the simulation
    served = (
        [entry]
        if not briefing.estimator
        else [entry, estimator(briefing.estimator, briefing.model)]
    )

    for part in served:
        if callable(getattr(part, "brief", None)):
            part.brief(briefing)
    vehicle = Vehicle.of(briefing.model)
    commands = CommandCodec(len(vehicle.joints), len(vehicle.thruster_names))
    estimates = EstimateCodec(len(vehicle.joints))

    # The simulation waits for the digests of the code and the periods before its first message.
    _tell_code(connection)
    connection.send_bytes(READY + " ".join(repr(float(part.period)) for part in served).encode())
    state: Any = None
    navigation: Any = None
    reference: Reference | None = None

    while True:
        message = connection.recv_bytes()
        kind = message[:1]
        if kind == MEASURED:
            navigation, estimate = served[1].step(navigation, pickle.loads(message[1:]))
            reply = estimates.encode_reply(estimate)
        elif kind == START_ESTIMATOR:
            navigation, reply = served[1].init(pickle.loads(message[1:])), READY
        elif kind == START_CONTROLLER:
            state, reply = entry.init(pickle.loads(message[1:])), READY
        else:
            estimate, changed = estimates.decode(message)
            reference = changed or reference
            assert reference is not None  # the first message contains set points
            state, command = entry.step(state, estimate, reference)
            reply = commands.encode(command)

        connection.send_bytes(reply)


def _tell_code(connection: Connection) -> None:
    """Send the digests of the files of project and entry that this process has loaded."""
    connection.send_bytes(LOADED + json.dumps(new_digests()).encode())


if __name__ == "__main__":
    main()
