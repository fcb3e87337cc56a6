"""Water identification: the fit in blocks against closed forms, words, planning, and logs that are
wrong.
"""

import numpy as np
import pytest

from uuv.calib.water.findings import findings, together
from uuv.calib.water.logs import log_of, read_log, write_log
from uuv.calib.water.named_fit import NamedParameter, Slopes, fit_blocks, values_of
from uuv.calib.water.planning import information, planned
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

THRUSTERS, JOINTS = ("bow", "stern"), {"elbow": (-1.5, 1.5)}


class Lines:
    """Three blocks of straight lines with one slope and an offset of each block."""

    def __init__(self, slope: float, offsets: Array, noise: float = 0.1) -> None:
        self.x, self.noise = np.linspace(0.0, 1.0, 12), noise
        self.y = [slope * self.x + offset for offset in offsets]
        self.local = [1] * len(offsets)
        self.parameters = (NamedParameter(name="slope", unit="1", nominal=1.0, sigma=2.0),)

    def residuals(self, deviations, local):
        slope = values_of(self.parameters, deviations)["slope"]
        return [
            (slope * self.x + b - y) / self.noise for (b,), y in zip(local, self.y, strict=True)
        ]

    def slopes(self, deviations, local):
        ones = np.ones((len(self.x), 1)) / self.noise
        return [
            Slopes(r, 2.0 * self.x[:, None] / self.noise, ones)
            for r in self.residuals(deviations, local)
        ]


def test_blocks_with_numbers_of_their_own_give_the_joint_posterior():
    lines = Lines(3.0, np.array([0.5, -1.0, 0.2]))
    fit = fit_blocks(lines, lines.parameters, rounds=20, enough=1e-12)
    # All unknowns at once: slope, three offsets, unit priors.
    A = np.zeros((36, 4))
    for k in range(3):
        A[12 * k : 12 * k + 12, 0], A[12 * k : 12 * k + 12, 1 + k] = 2.0 * lines.x / 0.1, 10.0
    y = (np.concatenate(lines.y) - np.tile(lines.x, 3)) / 0.1
    H = A.T @ A + np.eye(4)
    exact = np.linalg.solve(H, A.T @ y)
    assert fit.deviations[0] == pytest.approx(exact[0], abs=1e-6)
    assert np.concatenate(fit.local) == pytest.approx(exact[1:], abs=1e-6)
    assert fit.covariance[0, 0] == pytest.approx(np.linalg.inv(H)[0, 0], rel=1e-9)
    assert information(lines.slopes(np.zeros(1), [np.zeros(1)] * 3), 1)[0, 0] == pytest.approx(
        1.0 / np.linalg.inv(H)[0, 0] - 1.0, rel=1e-9
    )


def test_straight_steps_find_factors_far_from_nominal():
    """Force balance: gain over mass is told, their common scale is not; the words say so."""
    parameters = (
        NamedParameter(name="added mass surge", unit="kg", nominal=10.0, sigma=0.5, factor=True),
        NamedParameter(name="gain of bow", unit="1", nominal=1.0, sigma=0.5, factor=True),
        NamedParameter(name="net buoyancy", unit="N", nominal=0.0, sigma=1.0),
    )

    class Ratio:
        local = (0,)

        def residuals(self, deviations, local):
            v = values_of(parameters, deviations)
            return [
                (
                    v["gain of bow"] * 30.0 * np.linspace(0.5, 1.0, 20) / v["added mass surge"]
                    - np.linspace(3.0, 6.0, 20)
                )
                / 1e-3
            ]

        def slopes(self, deviations, local):
            (r,) = self.residuals(deviations, local)
            J = [(self.residuals(deviations + 1e-6 * e, local)[0] - r) / 1e-6 for e in np.eye(3)]
            return [Slopes(r, np.column_stack(J), np.zeros((20, 0)))]

    fit = fit_blocks(Ratio(), parameters, straight=True, enough=1e-9, rounds=20)
    assert fit.values["gain of bow"] / fit.values["added mass surge"] == pytest.approx(
        0.2, rel=1e-3
    )
    (said,) = together(fit, 3)
    assert "only their ratios are identifiable" in said
    assert "tow" in said
    found = {each.name: each for each in findings(fit, 3, SIGMAS)}
    assert found["net buoyancy"].verdict == "not identifiable"
    assert "drift" in found["net buoyancy"].helps
    assert found["gain of bow"].verdict == "partly identified"


def test_the_plan_names_what_sharpens_its_aim():
    parameters = tuple(
        NamedParameter(name=name, unit="1", nominal=0.0, sigma=1.0)
        for name in ("net buoyancy", "arm drag")
    )
    candidates = {"drift": np.diag([3.0, 0.0]), "swing": np.diag([0.0, 8.0])}
    assert planned(np.eye(2), candidates, parameters)[0].name == "swing"
    best = planned(np.eye(2), candidates, parameters, ("trim",))[0]
    assert (best.name, best.sharper()) == ("drift", pytest.approx(2.0))
    with pytest.raises(ConfigurationError, match="--aim 'speed': must be one of added mass"):
        planned(np.eye(2), candidates, parameters, ("speed",))


def columns(**changed: Array) -> dict[str, Array]:
    """A log of ten seconds at 20 Hz; columns may be changed or added."""
    t = np.arange(201) / 20.0
    zero = np.zeros_like(t)
    made = {
        "time": t,
        "x": 0.3 * np.sin(t),
        "y": zero,
        "z": zero,
        "qx": zero,
        "qy": zero,
        "qz": np.sin(0.2 * np.sin(t)),
        "qw": np.cos(0.2 * np.sin(t)),
    }
    made |= {"wx": zero, "wy": zero, "wz": 0.4 * np.cos(t), "joint.elbow": np.sin(t)}
    made |= {"thruster.bow": 0.5 * np.sin(t), "thruster.stern": zero}
    return {**made, **{name.replace("__", "."): values for name, values in changed.items()}}


def test_csv_and_parquet_hold_the_same_log(tmp_path):
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    log = log_of("log", columns(), thrusters=THRUSTERS, joints=JOINTS)
    write_log(tmp_path / "a.csv", log)
    table = columns()
    blank = np.arange(201) % 2 == 1  # a slower sensor: every other cell is null
    for name in ("x", "y", "z"):
        table[name] = np.where(blank, np.nan, table[name])
    arrays = {name: pa.array(values, mask=np.isnan(values)) for name, values in table.items()}
    pq.write_table(pa.table(arrays), tmp_path / "b.parquet")
    a, b = (
        read_log(tmp_path / name, thrusters=THRUSTERS, joints=JOINTS)
        for name in ("a.csv", "b.parquet")
    )
    assert a.channels["attitude"].values == pytest.approx(b.channels["attitude"].values, abs=1e-8)
    assert len(b.channels["position"].time) == 101
    assert a.joints["elbow"] == pytest.approx(log.joints["elbow"], abs=1e-8)
    assert a.commands["bow"] == pytest.approx(b.commands["bow"], abs=1e-8)


@pytest.mark.parametrize("end", ["\r", "\r\n"])
def test_every_kind_of_line_end_is_one(end: str, tmp_path):
    rows = (f"{0.02 * i:.2f},{0.01 * i:.2f},0.5,-5,0,0.6,0,0.8" for i in range(400))
    lines = ["time,x,y,z,qx,qy,qz,qw", *rows]
    (tmp_path / "ours.csv").write_bytes("\n".join(lines).encode())
    (tmp_path / "theirs.csv").write_bytes(end.join(lines).encode())
    ours, theirs = (
        read_log(tmp_path / f"{name}.csv", thrusters=(), joints={}) for name in ("ours", "theirs")
    )
    assert theirs.channels.keys() == ours.channels.keys() != set()
    for kind, channel in ours.channels.items():
        assert np.array_equal(theirs.channels[kind].values, channel.values)


def test_a_cell_without_end_is_one_line(tmp_path):
    (tmp_path / "dive.csv").write_text("time,x\n0.0," + "1" * 200_000 + "\n")
    with pytest.raises(
        ConfigurationError,
        match=r"log dive\.csv: cannot be read \(field larger "
        r"than field limit",
    ):
        read_log(tmp_path / "dive.csv", thrusters=(), joints={})


def test_a_gap_divides_a_log():
    table = columns()
    keep = (table["time"] < 4.0) | (table["time"] > 5.5)
    log = log_of(
        "log",
        {name: values[keep] for name, values in table.items()},
        thrusters=THRUSTERS,
        joints=JOINTS,
    )
    assert log.segments() == [
        (0.0, pytest.approx(3.95)),
        (pytest.approx(5.55), pytest.approx(10.0)),
    ]


T = np.arange(201) / 20.0
BAD = {
    "time must increase, but 2.05 s follows 3 s": {"time": np.where(T == 2.0, 3.0, T)},
    "time must be in s": {"time": 1000.0 * T * 20},
    "must last at least 4 s, got 0.01 s": {"time": T / 1000.0},
    "no column|unknown column 'speed'": {"speed": T},
    "unknown column 'thruster.bwo'; this vehicle has thruster.bow, thruster.stern.*did you mean "
    "thruster.bow": {"thruster__bwo": T},
    "unknown column 'joint.knee'; this vehicle has joint.elbow": {"joint__knee": T},
    "position changes by .* it must be in m": {"x": 300.0 * 100.0 * np.sin(T)},
    "must be a unit quaternion": {"qw": 0.5 + 0.0 * T},
    "rad/s \\(not deg/s\\)": {"wz": np.degrees(0.4 * np.cos(T))},
    "for a pulse in us it is \\(pulse - 1500\\) / 400": {
        "thruster__bow": 1500.0 + 200.0 * np.sin(T)
    },
    "of percent, a hundredth": {"thruster__bow": 50.0 * np.sin(T)},
    "these look like degrees": {"joint__elbow": np.degrees(np.sin(T))},
    "must have a command or a thrust, not both": {"thrust__bow": T},
    "velocity must have all of vx, vy, vz; 'vy' is missing": {"vx": T, "vz": T},
    "specific force \\[m/s\\^2\\]": {"ax": 0.0 * T, "ay": 0.0 * T, "az": 1.0 + 0.0 * T},
    "some of x, y, z are missing": {"x": np.where(T == 1.0, np.nan, T)},
    "upside down; .* in the order qx qy qz qw": {"qx": 1.0 + 0.0 * T, "qz": 0.0 * T, "qw": 0.0 * T},
}


@pytest.mark.parametrize("said", BAD)
def test_a_wrong_log_is_refused_in_one_line(said):
    with pytest.raises(ConfigurationError, match=said.partition("|")[2] or said) as refused:
        log_of("log dive.csv", columns(**BAD[said]), thrusters=THRUSTERS, joints=JOINTS)
    assert str(refused.value).startswith("log dive.csv: ")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,x,y,z\n0,0,0,nan\n1,0,0,0\n", "line 2, column 'z' is nan; leave a cell blank"),
        ("time,x,y,z\n0,0,0\n", "line 2 must have 4 cells as the first line, got 3"),
        ("time,x,y,z\n0,0,0,deep\n", "line 2, column 'z': expected a number, got 'deep'"),
        ("time,x,x\n0,0,0\n", "column 'x' occurs twice"),
        ("time,x,y,z\n0,0,0,0\n", "got 1 rows of numbers"),
        ("", "the file is empty"),
    ],
)
def test_a_wrong_csv_is_refused_with_its_line(tmp_path, text, said):
    (tmp_path / "dive.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        read_log(tmp_path / "dive.csv", thrusters=THRUSTERS, joints=JOINTS)
