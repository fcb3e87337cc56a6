"""A gamepad's records as an operator's inputs, by the reader of the device and by the command."""

import os
import struct
import threading
import time
from pathlib import Path

import pytest

from uuv.controllers.driving.gamepad_inputs import FULL, GamepadInputs
from uuv.controllers.driving.operator_inputs import COLUMNS, OperatorInputs
from uuv.driving.gamepad import Gamepad, take

BUTTON, AXIS, OPENED = 1, 2, 128


def record(kind: int, number: int, position: int, at: int = 0) -> bytes:
    """As linux/joystick.h has it: time [ms], value, kind, number."""
    return struct.pack("<IhBB", at, position, kind, number)


# What a pad sends: its state when opened, sticks, triggers, the cross, buttons.
STREAM = b"".join(
    [
        *(record(AXIS | OPENED, axis, 0) for axis in range(8)),
        *(record(BUTTON | OPENED, button, 0) for button in range(11)),
        record(AXIS, 1, -FULL, 1200),  # left stick ahead
        record(AXIS, 3, 2000, 1210),  # right stick, within its dead band
        record(AXIS, 7, -FULL, 1300),  # cross up, twice
        record(AXIS, 7, 0, 1350),
        record(AXIS, 7, -FULL, 1400),
        record(AXIS, 7, 0, 1450),
        record(AXIS, 5, -FULL + 1, 1500),  # right trigger begins to move
        record(AXIS, 5, FULL, 1600),
        record(BUTTON, 5, 1, 1700),  # right shoulder
        record(BUTTON, 0, 1, 1800),  # clutch
        record(BUTTON, 0, 0, 1810),
    ]
)


def test_sticks_are_velocities_and_the_cross_is_the_set_force():
    inputs = GamepadInputs()
    take(STREAM, inputs)
    expected = dict.fromkeys(inputs.values, 0.0) | {
        "surge": COLUMNS["surge"].most,
        "set_force": 20.0,
        "tool_z": COLUMNS["tool_z"].most,
        "heave": 0.5 * COLUMNS["heave"].most,
        "clutch": 0.0,
    }
    assert inputs.values == pytest.approx(expected)
    take(record(BUTTON, 1, 1), inputs)  # rest: the force stays
    assert inputs.values == pytest.approx(
        dict.fromkeys(inputs.values, 0.0) | {"set_force": 20.0, "clutch": 0.0}
    )


def test_a_stick_that_leans_when_the_device_is_opened_moves_nothing():
    inputs = GamepadInputs()
    before = inputs.values
    take(record(AXIS | OPENED, 1, -FULL) + record(BUTTON | OPENED, 7, 1), inputs)
    assert inputs.values == before


@pytest.mark.parametrize("axis", range(8))
def test_every_position_stays_within_the_bounds(axis):
    inputs = GamepadInputs()
    for position in (-32_768, -FULL, -1, 0, 1, FULL):
        for _ in range(20):
            inputs.move(axis, position)
        for name, value in inputs.values.items():
            assert COLUMNS[name].least <= value <= COLUMNS[name].most


def awaited(condition, seconds: float = 5.0) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def test_records_that_arrive_in_parts_are_read_and_an_unplugged_pad_ends_the_inputs(tmp_path: Path):
    device = tmp_path / "js0"
    os.mkfifo(device)
    inputs = GamepadInputs()
    inputs.poll(0.0)
    writer = os.open(device, os.O_RDWR)
    try:
        with Gamepad(str(device), inputs):
            for part in (STREAM[:13], STREAM[13:170], STREAM[170:]):
                os.write(writer, part)
            assert awaited(lambda: inputs.values["clutch"] == 0.0)
            inputs.poll(1.0)
            os.close(writer)
            writer = -1

            def ended() -> bool:
                inputs.poll(inputs.rows[-1][0] + 0.1)
                return inputs.ended

            assert awaited(ended)
    finally:
        if writer >= 0:
            os.close(writer)

    # The rows are a file of inputs.
    file = tmp_path / "kept.csv"
    file.write_text(inputs.text())
    assert OperatorInputs.read(file).rows == inputs.rows
    assert inputs.rows[1][1] == COLUMNS["surge"].most


def test_what_is_no_device_is_refused_by_the_command(verb, tmp_path: Path):
    (tmp_path / "js0").write_bytes(STREAM)
    for name, reason in (("js0", "it is none"), ("js1", "No such file")):
        ran = verb("drive", "open-water", "--gamepad", tmp_path / name)
        assert ran.returncode == 2
        assert "gamepad: must be a joystick device such as /dev/input/js0" in ran.stderr
        assert reason in ran.stderr
    both = verb("drive", "open-water", "--gamepad", "/dev/null", "--inputs", "in.csv")
    assert both.stderr.strip() == "error: --gamepad and --inputs: give only one of them"


@pytest.mark.long(
    guarded_by="tests/unit/uuv/driving/test_gamepad.py::"
    "test_records_that_arrive_in_parts_are_read_and_an_unplugged_pad_ends_the_inputs"
)
def test_a_hull_is_driven_by_the_command_and_its_inputs_are_kept(
    verb, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("DISPLAY", raising=False)  # without a window
    device = tmp_path / "js0"
    os.mkfifo(device)
    writer = os.open(device, os.O_RDWR)
    out = tmp_path / "run"
    try:
        os.write(writer, record(AXIS, 1, -FULL))
        pushed = threading.Timer(30.0, os.write, (writer, record(BUTTON, 7, 1)))
        pushed.start()
        ran = verb(
            "drive", "open-water", "--gamepad", device, "--pace", 2, "--no-record", "--out", out
        )
        pushed.cancel()
    finally:
        os.close(writer)
    assert ran.returncode == 0, ran.stderr
    rows = OperatorInputs.read(out / "inputs.csv").rows
    assert rows[0][1] == COLUMNS["surge"].most
    assert "the inputs ended" in ran.stdout
