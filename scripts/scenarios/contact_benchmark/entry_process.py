"""Process of an entry: makes the controller from its briefing and answers every estimate with a command.

Started by `scenarios.contact_benchmark.door`; it has no simulation. Its one argument is the number of its socket.
"""

import sys
from multiprocessing.connection import Connection
from typing import Any

from models.vehicle import Vehicle
from scenarios.contact_benchmark.wire import FAILED, READY, Briefing, CommandCodec, EstimateCodec
from scenarios.contact_parts import controller
from sim.interfaces.errors import one_line
from sim.interfaces.messages import Reference


def main() -> None:
    """Serves until the simulation closes the connection; an error of the entry ends it with one line."""
    connection = Connection(int(sys.argv[1]))
    try:
        serve(connection)
    except EOFError:
        return
    except Exception as error:
        connection.send_bytes(FAILED + f"{type(error).__name__}: {one_line(str(error))}".encode())


def serve(connection: Connection) -> None:
    """Answers messages until the connection is closed.

    Raises:
        EOFError: The simulation closed it.
        Exception: The entry raised.
    """
    briefing: Briefing = connection.recv()
    wrapped: Any = controller(briefing.control, briefing.model, water_error=briefing.water_error)
    entry = wrapped.controller  # the safety wrapper itself runs in the simulation
    if callable(getattr(entry, "brief", None)):
        entry.brief(briefing)
    vehicle = Vehicle.of(briefing.model)
    codec, estimates = (
        CommandCodec(len(vehicle.joints), len(vehicle.thruster_names)),
        EstimateCodec(len(vehicle.joints)),
    )
    connection.send_bytes(READY + repr(float(entry.period)).encode())
    state: Any = entry.init(connection.recv())
    connection.send_bytes(READY)
    reference: Reference | None = None
    while True:
        estimate, changed = estimates.decode(connection.recv_bytes())
        reference = changed or reference
        assert reference is not None  # the first message brings one
        state, command = entry.step(state, estimate, reference)
        connection.send_bytes(codec.encode(command))


if __name__ == "__main__":
    main()
