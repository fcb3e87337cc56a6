"""An autopilot of another maker flies a vehicle behind `uuv serve ardupilot`, over its socket."""

import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager

import numpy as np
import pytest

from foreign_autopilot import MOTORS, NEUTRAL, RATE, Autopilot, Link, square

DEPTH, STEADY = 3.0, 20.0  # [m], [s] after which a hold is judged


@contextmanager
def served(*words: str) -> Iterator[tuple[int, subprocess.Popen[str]]]:
    """The command in a process of its own, and its port."""
    command = [sys.executable, "-m", "uuv", "serve", "ardupilot", "--port", "0", "--json", *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        try:
            line = next(line for line in process.stderr if "UDP port" in line)
            found = re.search(r"UDP port (\d+)", line)
            assert found is not None
            yield int(found[1]), process
        finally:
            process.terminate()


@pytest.mark.long(
    guarded_by="tests/unit/uuv/serve/test_ardupilot.py::"
    "test_a_foreign_controller_holds_depth_and_heading_over_the_socket"
)
@pytest.mark.parametrize(("frame", "most"), [("vectored", 0.10), ("vectored_6dof", 0.02)])
def test_a_depth_is_held_for_a_minute_and_a_square_is_flown(
    frame: str, most: float, record_property
) -> None:
    """In a current of 0.1 m/s from the south; a hull of six motors swings about its depth, for
    below their dead band the motors do nothing.
    """
    still = [NEUTRAL] * len(MOTORS[frame])
    words = ("--frame", frame, "--current", "0.1", "0", "0")
    with served(*words) as (port, _), closing(Link(port)) as link:
        pilot = Autopilot(frame)
        state = link.exchange(still)
        assert state["timestamp"] == pytest.approx(1.0 / RATE)

        depths = []
        for _ in range(60 * RATE):
            state = link.exchange(pilot.pulses(state, 0.0, 0.0, DEPTH))
            depths.append(state["position"][2])
        off = np.abs(np.array(depths[round(STEADY * RATE) :]) - DEPTH)

        away = []
        for step in range(48 * RATE):
            place = square(step / RATE)
            state = link.exchange(pilot.pulses(state, *place, DEPTH))
            away.append(math.dist(place, state["position"][:2]))

    figures = {
        "depth RMS [m]": float(np.sqrt(np.mean(off**2))),
        "depth, largest [m]": float(off.max()),
        "square RMS [m]": float(np.sqrt(np.mean(np.square(away)))),
        "square, largest [m]": max(away),
        "heading at the end [rad]": state["attitude"][2],
    }
    record_property("figures", json.dumps(figures))
    print(frame, figures)
    assert off.max() < most  # measured 0.065 and 0.004 m
    assert max(away) < 0.4  # measured 0.23 and 0.29 m, behind a place that moves at 0.2 m/s
    assert abs(state["attitude"][2]) < 0.05


@pytest.mark.long(guarded_by="tests/unit/uuv/serve/test_ardupilot.py::test_thirty_two_channels")
def test_handshake_repeat_reset_and_32_channels_over_the_socket() -> None:
    """As the public document has them; the door counts what came."""
    words = ("--frame", "vectored", "--seconds", "0.5")
    with served(*words) as (port, process), closing(Link(port, channels=32)) as link:
        ahead = [NEUTRAL] * 6
        for motor, sign in enumerate((-1, -1, 1, 1)):
            ahead[motor] += 200 * sign
        first = link.exchange(ahead)
        assert set(first) >= {"timestamp", "imu", "position", "velocity", "attitude"}
        states = [link.exchange(ahead) for _ in range(10)]
        state = states[-1]
        assert state["velocity"][0] > 0.0
        assert link.again(ahead) == state

        # SITL that starts anew counts from 0: the vehicle is at its start again.
        link.count = -1
        again = link.exchange(ahead)
        assert again["timestamp"] == pytest.approx(0.01)
        assert again == first
        for _ in range(60):
            if link.exchange(ahead)["timestamp"] >= 0.5 - 1e-9:
                break
        output, _ = process.communicate(timeout=60)
    counts = json.loads(output)
    assert (counts["repeated"], counts["restarts"], counts["refused"]) == (1, 1, 0)
    assert counts["simulated_s"] == pytest.approx(0.5)
