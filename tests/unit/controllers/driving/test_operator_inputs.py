"""Inputs of an operator: files, their refusals, and keys."""

from pathlib import Path

import numpy as np
import pytest

from driving_rows import rows_of, text_of
from uuv.controllers.driving.key_inputs import KeyInputs
from uuv.controllers.driving.operator_inputs import COLUMNS, LONGEST, OperatorInputs
from uuv.sim.interfaces.errors import ConfigurationError

NAMES = tuple(COLUMNS)
STEPS = ((1.0, {"surge": 0.2, "turn_z": 0.1}), (2.0, {"set_force": 40.0, "clutch": 0.0}))


def test_a_row_holds_until_the_next_and_the_last_one_ends(tmp_path: Path):
    file = tmp_path / "in.csv"
    file.write_text(text_of(rows_of(STEPS)))
    inputs = OperatorInputs.read(file)

    before, driven = inputs.at(0.49), inputs.at(1.49)
    assert before is not None
    assert not before.clutch
    assert driven is not None
    assert driven.clutch
    assert driven.hull.tolist() == [0.2, 0.0, 0.0, 0.0]
    assert driven.turn.tolist() == [0.0, 0.0, 0.1]

    opened = inputs.at(3.49)
    assert opened is not None
    assert not opened.clutch
    assert opened.set_force == 40.0
    assert inputs.at(3.5) is None
    assert inputs.largest_force == 40.0

    # The last row only ends them.
    ending = [*rows_of(STEPS)[:-1], [99.0 if name != "time" else 3.5 for name in NAMES]]
    assert OperatorInputs(ending).largest_force == 40.0


def test_columns_may_come_in_any_order_without_the_turns(tmp_path: Path):
    file = tmp_path / "in.csv"
    head = [name for name in reversed(NAMES) if not name.startswith("turn")]
    rows = [[row[NAMES.index(name)] for name in head] for row in rows_of(STEPS)]
    file.write_text(text_of(rows, head))
    driven = OperatorInputs.read(file).at(1.0)
    assert driven is not None
    assert driven.hull[0] == 0.2
    assert not driven.turn.any()


def test_what_is_written_is_read_to_the_bit(tmp_path: Path):
    third = [(1.0 / 3.0, {"sway": -0.1 / 3.0})]
    inputs = OperatorInputs(rows_of(third))
    file = tmp_path / "kept.csv"
    file.write_text(inputs.text())
    assert OperatorInputs.read(file).rows == inputs.rows


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (text_of(rows_of([(1.0, {"surge": 3.0})])), r"line 2: surge \[m/s\]: .*0.25, got 3"),
        (text_of(rows_of([(1.0, {"set_force": -1.0})])), r"set_force \[N\]: .*got -1"),
        (text_of(rows_of([(1.0, {"set_force": np.nan})])), r"set_force \[N\]: .*got nan"),
        (text_of(rows_of([(1.0, {"clutch": 0.5})])), "clutch: must be 0 .open. or 1"),
        (text_of(rows_of([(0.0, {})])), "line 3: time .s.: must increase, got 0.5 after 0.5"),
        (text_of(rows_of([(1e4, {})])), r"line 3: time \[s\]: .*3600"),
        (text_of([]), "at least two rows, got 0"),
        (text_of(rows_of([(1.0, {})])).replace("surge", "speed"), "no column 'speed'"),
        (text_of(rows_of([(1.0, {})])).replace("surge,", ""), "column surge is missing"),
        (text_of(rows_of([(1.0, {})]), (*NAMES, "time")), "a column occurs twice"),
        (text_of(rows_of([(1.0, {})])) + "1,2\n", "line 4: must have 13 numbers, got 2"),
        (text_of(rows_of([(1.0, {})])) + "x" + ",0" * 12, "line 4: time .s.: must be a number"),
        (text_of(rows_of([(1.0, {})])) + '"', "line 4: "),
    ],
)
def test_bad_files_are_refused_with_line_and_column(tmp_path: Path, text: str, message: str):
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=message) as refusal:
        OperatorInputs.read(file)
    assert "\n" not in str(refusal.value)


def test_keys_become_rows_that_a_file_repeats(tmp_path: Path):
    keys = KeyInputs()
    keys.poll(0.0)
    for key in (ord("I"), ord("I"), 266, ord("6"), ord("?")):
        keys.press(key)
    before = keys.at(0.5)  # nothing was noted since
    assert before is not None
    assert before.hull[0] == 0.0
    keys.poll(1.0)
    driven = keys.at(1.0)
    assert driven is not None
    assert driven.clutch
    assert driven.hull[0] == pytest.approx(0.4 * COLUMNS["surge"].most)
    assert driven.tool[2] == pytest.approx(-0.2 * COLUMNS["tool_z"].most)
    assert driven.set_force == 60.0

    # At rest with the force kept, then open, then over
    keys.press(32)
    keys.press(257)
    keys.poll(2.0)
    opened = keys.at(2.0)
    assert opened is not None
    assert not opened.hull.any()
    assert not opened.clutch
    assert opened.set_force == 60.0
    keys.press(269)
    keys.poll(3.0)
    assert keys.at(3.0) is None

    file = tmp_path / "kept.csv"
    file.write_text(keys.text())
    kept = OperatorInputs.read(file)
    assert kept.rows == keys.rows


@pytest.mark.parametrize("polls", [(), (0.0,), (0.0, 0.5, 1.0, 1.5)])
def test_keys_that_have_not_ended_are_repeated_up_to_the_last_poll(
    tmp_path: Path, polls: tuple[float, ...]
):
    keys = KeyInputs()
    asked = []
    for time in polls:
        keys.press(ord("I"))
        keys.poll(time)
        asked.append(keys.at(time))

    file = tmp_path / "kept.csv"
    file.write_text(keys.text())
    again = OperatorInputs.read(file)
    for time, one in zip(polls, asked, strict=True):
        other = again.at(time)
        assert one is not None
        assert other is not None
        assert one.hull.tolist() == other.hull.tolist()
        assert one.clutch is other.clutch
    assert again.at(max(polls, default=0.0) + 0.01) is None


def test_a_window_that_is_closed_at_once_leaves_inputs_that_end(tmp_path: Path):
    keys = KeyInputs()
    keys.end()
    keys.poll(0.0)
    keys.poll(0.01)
    assert keys.at(0.01) is None
    file = tmp_path / "kept.csv"
    file.write_text(keys.text())
    assert OperatorInputs.read(file).rows == keys.rows


def test_keys_end_where_those_of_a_file_must(tmp_path: Path):
    keys = KeyInputs()
    keys.poll(LONGEST - 0.5)
    keys.poll(LONGEST + 0.5)
    assert keys.at(LONGEST) is None
    file = tmp_path / "kept.csv"
    file.write_text(keys.text())
    assert OperatorInputs.read(file).duration == LONGEST


def test_a_key_held_down_stays_within_bounds():
    keys = KeyInputs()
    for _ in range(20):
        keys.press(ord("K"))
    keys.poll(0.0)
    driven = keys.at(0.0)
    assert driven is not None
    assert driven.hull[0] == COLUMNS["surge"].least
