"""Connects other programs to a vehicle: `uuv serve ardupilot`, `uuv serve udp`."""

import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from uuv.cli.carry_out import METRICS
from uuv.cli.json_output import file_alone, print_json
from uuv.cli.live.named_job import NamedJobOptions, named_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse

if TYPE_CHECKING:  # not needed for a help text
    from uuv.serve.ardupilot import ArduPilotDoor


@dataclass(kw_only=True)
class ArduPilotOptions:
    """Serve the physics of a vehicle to ArduPilot's simulation (SITL), in lockstep, as JSON.

    Start SITL with `--model JSON:127.0.0.1`. Ctrl-C ends the command with exit code 0.
    """

    frame: str = "vectored_6dof"
    """ArduSub's motor frame: vectored (FRAME_CONFIG 1) or vectored_6dof (2)."""
    vehicle: str | None = None
    """Named vehicle (`uuv list vehicles`) with the thrusters of that frame; default: bluerov2 for
    vectored, bluerov2_heavy for vectored_6dof."""
    port: int = 9002
    """UDP port; 0: any that is free."""
    listen: str = "127.0.0.1"
    """Address to listen on; default: this machine alone."""
    depth: float = 1.0
    """Depth at the start [m]."""
    current: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Current [m/s] to the north, east, down."""
    bottom: float | None = None
    """Depth of a level bottom [m], for a range finder that looks down (rng_1)."""
    directions: tuple[int, ...] = ()
    """MOT_n_DIRECTION of the autopilot, 1 or -1 for each motor, if they are not all 1."""
    arm_channels: tuple[int, ...] = ()
    """Channel of each joint of the arm; 1100 to 1900 us cover its range. Default: arm held at
    home."""
    seconds: float | None = None
    """End after this simulated time [s]."""
    json: bool = False
    """Print the counts of packets as JSON at the end."""


@dataclass(kw_only=True)
class UdpOptions(NamedJobOptions):
    """Run a job whose controller is another process, over UDP (docs/udp.md).

    Without --pace it runs in lockstep: the simulation waits for each command.
    """

    port: int = 9010
    """UDP port; 0: any that is free."""
    listen: str = "127.0.0.1"
    """Address to listen on; default: this machine alone."""
    rate: float = 500.0
    """Commands a second of simulated time [Hz]: 100 to 500."""


def main(verb: str, args: Sequence[str]) -> int:
    """Serves until it is ended; returns the exit code."""
    return _serve_udp(args) if verb == "serve udp" else _serve_ardupilot(args)


def _serve_udp(args: Sequence[str]) -> int:
    """Serves a job to a controller in another process."""
    options = parse(UdpOptions, args)
    started = time.perf_counter()
    scenario = named_scenario(options)
    from uuv.inputs import check_inputs

    check_inputs(scenario, options.longest)
    from uuv.serve.datagrams import listening
    from uuv.serve.served_job import run_remote

    with listening(options.port, options.listen) as endpoint:
        # With --json, standard output is the figures alone.
        to = sys.stderr if options.json else sys.stdout
        ready = f"{scenario.name} on UDP port {endpoint.port} of {options.listen}"
        print(ready, file=to, flush=True)

        def work() -> int:
            return run_remote(scenario, options, endpoint, started, rate=options.rate, counts=to)

        return file_alone(work, METRICS) if options.json else work()


def _serve_ardupilot(args: Sequence[str]) -> int:
    """Serves the physics of a vehicle to an autopilot."""
    options = parse(ArduPilotOptions, args)
    from uuv.serve.datagrams import answer_all, listening

    if options.seconds is not None and not (
        math.isfinite(options.seconds) and options.seconds > 0.0
    ):
        raise ConfigurationError(f"--seconds: must be above 0, got {options.seconds}")

    with listening(options.port, options.listen) as endpoint:
        door = _door(options)
        longest = math.inf if options.seconds is None else options.seconds
        name = door.vehicle.name
        ready = f"{name} as frame {options.frame}, on UDP port {endpoint.port} of {options.listen}"
        print(ready, file=sys.stderr if options.json else sys.stdout, flush=True)

        try:
            answer_all(endpoint, door.reply, lambda: door.vehicle.time >= longest - 1e-9)
        except KeyboardInterrupt:  # the usual end
            pass
        finally:
            _print_end(door, as_json=options.json)
    return 0


def _print_end(door: "ArduPilotDoor", *, as_json: bool) -> None:
    """Print the counts of packets, and the simulated time."""
    traffic = door.traffic
    simulated = door.vehicle.time
    if as_json:
        print_json({"simulated_s": simulated, **asdict(traffic)})
        return

    print(f"{simulated:.1f} s simulated; packets: {traffic.summary()}")
    if traffic.reason:
        print(f"last refused packet: {traffic.reason}")


def _door(options: ArduPilotOptions) -> "ArduPilotDoor":
    """Connection of a vehicle to the autopilot, from the options."""
    from uuv.serve.ardupilot import ArduPilotDoor
    from uuv.serve.served_vehicle import DiveSite

    north, east, down = options.current
    water = DiveSite(
        depth=options.depth,
        current_W=(north, -east, -down),
        bottom=math.inf if options.bottom is None else options.bottom,
    )
    return ArduPilotDoor(
        options.frame,
        vehicle=options.vehicle or "",
        water=water,
        directions=options.directions,
        arm_channels=options.arm_channels,
    )
