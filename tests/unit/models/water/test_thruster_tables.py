"""Thrusters as bought: a table over pulse and voltage, the T200's, and files of makers."""

from pathlib import Path

import numpy as np
import pytest

from uuv.models.water import thrusters
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thruster_tables import T200, ThrusterTable
from uuv.sim.interfaces.errors import ConfigurationError

# [V], pulse [us] and thrust [N] of the maker's sheets, between the points that are kept
SHEETS = (
    (10.0, 1800.0, 18.77),
    (14.0, 1700.0, 15.21),
    (16.0, 1300.0, -14.10),
    (20.0, 1200.0, -30.65),
)


def thrust_of(kind: thrusters.Thruster, pulse: float) -> float:
    curve = thrusters.curves(thrusters.pack(kind)[None])[0]
    return thrust_at(curve, (pulse - 1500.0) / 400.0)


@pytest.mark.parametrize(("voltage", "pulse", "thrust"), SHEETS)
def test_the_t200_is_that_of_its_sheets(
    voltage: float, pulse: float, thrust: float, within
) -> None:
    full = float(T200.thrust(1900.0, voltage))
    within("thrust over full scale", (T200.thrust(pulse, voltage) - thrust) / full, 0.03)
    kind = thrusters.t200(voltage=voltage)
    within("the curve, over full scale", (thrust_of(kind, pulse) - thrust) / full, 0.03)


def test_a_voltage_left_out_is_met_by_its_neighbours(within) -> None:
    """RMS over the pulse, over full scale; the sheets of 10 and 20 V have data on one side only."""
    pulses = np.linspace(1100.0, 1900.0, 161)
    for left_out in (1, 2):
        kept = np.delete(np.arange(4), left_out)
        others = ThrusterTable(
            name="t200",
            voltages=T200.voltages[kept],
            ends=T200.ends,
            edges=T200.edges[kept],
            shares=T200.shares,
            astern=T200.astern[kept],
            ahead=T200.ahead[kept],
        )
        voltage = float(T200.voltages[left_out])
        error = others.thrust(pulses, voltage) - T200.thrust(pulses, voltage)
        assert np.abs(error).max() > 0.1  # or nothing was left out
        full = float(T200.thrust(1900.0, voltage))
        within("thrust error, RMS", np.sqrt(np.mean(error**2)) / full, 0.03)


def test_sixteen_volts_are_what_they_were_and_less_is_weaker() -> None:
    assert thrusters.t200() == thrusters.t200(voltage=16.0)
    ends = [thrusters.t200(voltage=voltage).forward for voltage in (10.0, 12.0, 14.0, 16.0, 18.0)]
    assert ends == sorted(ends)
    assert 0.6 * ends[3] < ends[1] < 0.8 * ends[3]
    assert T200.power_at(1900.0, 14.0) == pytest.approx(285.0)
    assert T200.power_at(1500.0, 14.0) == 0.0
    for voltage in (10.0, 13.3, 20.0):  # dead in the middle
        assert thrust_of(thrusters.t200(voltage=voltage), 1490.0) == 0.0


@pytest.mark.parametrize("voltage", [9.9, 20.1, float("nan"), "a"])
def test_a_voltage_that_was_not_measured_is_refused(voltage) -> None:
    with pytest.raises(ConfigurationError, match=r"t200: voltage \[V\]"):
        thrusters.t200(voltage=voltage)


def csv(folder: Path, thrust=lambda u, v: v * u * np.abs(u), more: str = "") -> Path:
    lines = ["pulse_us,force_N,voltage_V"]
    for voltage in (12.0, 24.0):
        for pulse in np.linspace(1000.0, 2000.0, 101):
            share = (pulse - 1500.0) / 500.0
            force = 0.0 if abs(share) < 0.05 else float(thrust(share, voltage))
            lines.append(f"{pulse},{force!r},{voltage}")
    (folder / "maker.csv").write_text("\n".join(lines) + more)
    return folder / "maker.csv"


def test_a_makers_file_is_a_thruster_at_its_voltages(tmp_path: Path, within) -> None:
    table = ThrusterTable.of_csv(csv(tmp_path))
    assert table.neutral == 1500.0
    for share in (-0.8, -0.31, 0.02, 0.47, 0.9):
        exact = 0.0 if abs(share) < 0.05 else 18.0 * share * abs(share)
        within("between two voltages [N]", table.thrust(1500.0 + 500.0 * share, 18.0) - exact, 0.02)
    kind = thrusters.from_table(tmp_path / "maker.csv", 18.0, time_constant=0.2)
    assert (kind.forward, kind.reverse, kind.time_constant) == pytest.approx((18.0, 18.0, 0.2))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("pulse,force\n1,2\n", "needs the columns pulse_us, force_N; it lacks pulse_us, force_N"),
        ("pulse_us,force_N\n1500,x\n", "column force_N: numbers are missing"),
        ("pulse_us,force_N\n1100,-3\n1500,0\n1900,nan\n", "column force_N: must be finite"),
        ("pulse_us,force_N\n1100,0\n1500,1\n1900,3\n", "at 0 V it has thrust one way only"),
        (
            "pulse_us,force_N\n1100,-3\n1400,-1\n1600,1\n1700,5\n1900,4\n",
            "at 0 V the thrust ahead does not rise",
        ),
    ],
)
def test_a_slip_in_a_makers_file_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "maker.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        thrusters.from_table(tmp_path / "maker.csv")
