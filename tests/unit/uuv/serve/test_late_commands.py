"""The work controller behind a link in simulated time: late, and in time."""

from dataclasses import replace

import numpy as np
import pytest

from experiments.runtime.udp_links import BEGIN, JOB, LINKS, behind, own_answer
from uuv import jobs
from uuv.assembly import assemble
from uuv.runner import run
from uuv.serve import client
from uuv.sim.interfaces.messages import WorkState

GAINS = ("stiffness", "damping", "compensation")


def held(answer, link, seconds):
    """Largest joint speed [rad/s] in the second half of a rest, and the run."""
    fastest = []

    def watched(frame):
        if frame.time > 0.5 * seconds:
            fastest.append(max(map(abs, frame.qd)))
        return answer(frame)

    assembly, remote = behind(assemble(jobs.clean_barrel(quick=True)), watched, link)
    run(assembly, longest=seconds)
    return max(fastest), remote


def without_gains(answer):
    """The same commands, which nobody carries on."""

    def stripped(frame):
        command = client.unpack(answer(frame))
        zeros = {name: (0.0,) * len(command.values[name]) for name in GAINS}
        return client.pack(replace(command, values=command.values | zeros))

    return stripped


def test_late_commands_hold_the_arm_where_they_are_carried_on():
    speed, remote = held(own_answer(JOB), LINKS["late"], 1.0)
    assert 0.046 < remote.traffic.oldest_s < 0.052
    assert remote.traffic.silent == 0
    assert speed < 0.2  # measured 0.035


@pytest.mark.long(
    guarded_by="tests/unit/uuv/serve/test_late_commands.py::"
    "test_late_commands_hold_the_arm_where_they_are_carried_on"
)
def test_without_gains_the_servo_is_unstable_over_the_same_link():
    speed, _ = held(without_gains(own_answer(JOB)), LINKS["late"], 1.0)
    assert speed > 2.0  # measured 10


@pytest.mark.long(
    guarded_by="tests/unit/uuv/serve/test_late_commands.py::"
    "test_late_commands_hold_the_arm_where_they_are_carried_on"
)
@pytest.mark.parametrize("link", ["late", "late, lost, doubled", "bursts"])
def test_contact_is_held_over_a_bad_link(link):
    scenario = jobs.clean_barrel(quick=True, sensor="survey")
    assembly, _ = behind(assemble(scenario), own_answer(JOB), LINKS[link], begin=BEGIN)
    done = run(assembly)
    recording = done.recording
    assert recording.final.state is WorkState.DONE, recording.final.note

    peak = np.max(recording["contact_most"].scalar - 0.2 * recording["set_force"].scalar.max())
    assert peak <= recording["set_force"].scalar.max()
