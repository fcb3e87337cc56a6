"""A wrong file, table or length is refused with its odds; right ones are not, and units that are
stated stay.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from uuv.calib import identify
from uuv.calib.arm_files import read_arm
from uuv.calib.moving_base import BASE_JOINTS, on_moving_base, own_parameters, with_base
from uuv.calib.parameters import widest_prior
from uuv.calib.simulation import touch, wrong_arm
from uuv.calib.verdicts.doubts import Examination, coincide, examine
from uuv.calib.verdicts.evidence import Told
from uuv.models.arms import published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

TIP = np.array([0.06, -0.02, 0.15])
STRAIGHT = np.array([0.0, 0.0, 0.15])  # on the last axis of the nominal arm
X_BA = pose(exp_so3([2.9, 0.3, -0.2]), [0.2, -0.05, 0.1])
ERRORS = {"theta": 4e-3, "d": 1e-3, "a": 1e-3, "alpha": 4e-3}
POINTS = np.array([[0.45, -0.3, 0.2], [0.4, 0.35, 0.3], [-0.4, 0.3, 0.25]])
APART = float(np.linalg.norm(POINTS[0] - POINTS[1]))
NAMES = ("a", "b", "c")
Series = list[Array]


@pytest.fixture(scope="module")
def nominal() -> SerialArm:
    return published_arms.load("panda")


@pytest.fixture(scope="module")
def series(nominal: SerialArm) -> Series:
    rng = np.random.default_rng(4)
    return touch(wrong_arm(nominal, ERRORS, rng), TIP, rng, points=POINTS, touches=16)


@pytest.fixture(scope="module")
def straight(nominal: SerialArm) -> Series:
    """Touches with a straight pin, which errors of the arm put 1 mm beside the last axis."""
    rng = np.random.default_rng(4)
    return touch(wrong_arm(nominal, ERRORS, rng), STRAIGHT, rng, points=POINTS, touches=16)


def examined(series: Series, nominal: SerialArm, length: float = APART) -> Examination:
    lengths = [(0, 1, length, 5e-5)] if len(series) > 1 else []
    fit = identify(series, nominal, distances=lengths)
    names = NAMES[: len(series)]
    return examine(
        fit, series, partial(identify, nominal=nominal), Told(names=names, distances=lengths)
    )


def doubted(series: Series, nominal: SerialArm, length: float = APART) -> str:
    return "; ".join(map(str, examined(series, nominal, length).doubts))


def columns(*order: int) -> Callable[[Series], Series]:
    return lambda series: [np.ascontiguousarray(q[:, list(order)]) for q in series]


def scaled(joint: int, factor: float) -> Callable[[Series], Series]:
    return lambda series: [
        q * np.where(np.arange(q.shape[1]) == joint, factor, 1.0) for q in series
    ]


WRONG = {
    "two points in one file": (lambda s: [np.vstack(s[:2]), s[2]], "touches of two points"),
    "columns exchanged": (columns(0, 1, 4, 3, 2, 5, 6), "columns 3 and 5 exchanged"),
    "sign flipped": (scaled(3, -1.0), "joint 4 with the opposite sign"),
    "degrees turned twice": (
        scaled(3, np.pi / 180.0),
        "joint 4 converted from degrees once too often",
    ),
    "the same file twice": (lambda s: [s[0], s[0], s[2]], "the same touches were written twice"),
    "repeated rows": (
        lambda s: [
            np.vstack([q[:4]] * 4) + 1e-5 * np.sin(np.arange(7 * 16)).reshape(16, 7) for q in s
        ],
        "the others repeat them",
    ),
    "a column that stands still": (
        lambda s: [np.where(np.arange(7) == 2, q[0], q) for q in s],
        "joint 3 moves by 0.0 deg",
    ),
    "a zero of ten degrees": (
        lambda s: [q + 0.17 * (np.arange(7) == 1) for q in s],
        "theta2 would be wrong by",
    ),
    "a zero set anew in one file": (
        lambda s: [s[0], s[1] + np.deg2rad(2.0) * (np.arange(7) == 2), s[2]],
        "joint 3 reads +2",
    ),
    "a joint that slips": (
        lambda s: [
            s[0],
            s[1],
            np.where(np.arange(16)[:, None] < 9, s[2], s[2] - 0.05 * (np.arange(7) == 4)),
        ],
        "from touch 10 of c on",
    ),
    "a reading that froze": (
        lambda s: [
            np.where((np.arange(7) == 3) & (np.arange(16)[:, None] % 16 > 10), q[11], q) for q in s
        ],
        "joint 4 has the same reading in 15 touches, of which",
    ),
    "too few touches": (lambda s: [s[0][:4]], "too few"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_file_is_refused_by_its_name(kind: str, series: Series, nominal: SerialArm) -> None:
    spoil, words = WRONG[kind]
    assert words in doubted(spoil(series), nominal)


def test_right_files_are_not_doubted(series: Series, nominal: SerialArm) -> None:
    assert doubted(series, nominal) == ""
    assert doubted(series, nominal, 1.002 * APART) == ""


def last_column(change: Callable[[Array], Array]) -> Callable[[Series], Series]:
    return lambda series: [np.column_stack([q[:, :-1], change(q[:, -1])]) for q in series]


HIDDEN = {
    "in another order": np.random.default_rng(1).permutation,
    "a row late": lambda q: np.roll(q, 1),
    "frozen for a third": lambda q: np.where((np.arange(16) > 4) & (np.arange(16) < 11), q[5], q),
}


@pytest.mark.parametrize("kind", HIDDEN)
def test_readings_that_hide_in_the_noise_are_refused(
    kind: str, straight: Series, nominal: SerialArm
) -> None:
    assert doubted(straight, nominal) == ""
    words = doubted(last_column(HIDDEN[kind])(straight), nominal)
    assert "the readings of joint 7 are not those of these touches" in words
    assert "to 1)" in words


def test_a_joint_that_explains_nothing_is_said(nominal: SerialArm) -> None:
    """With the tip on the last axis no order of its readings is wrong, and none of its parameters
    moves.
    """
    rng = np.random.default_rng(4)
    series = touch(nominal, STRAIGHT, rng, points=POINTS, touches=16)
    for rows in (series, last_column(rng.permutation)(series)):
        examined_fit = examined(rows, nominal)
        assert examined_fit.doubts == ()
        assert any(
            "the readings of joint 7 are not checked" in line for line in examined_fit.untold
        )


def test_a_mirror_image_is_said_where_the_arm_has_one(series: Series, nominal: SerialArm) -> None:
    rng = np.random.default_rng(7)
    alike = published_arms.load("iiwa7")
    touches = touch(wrong_arm(alike, ERRORS, rng), TIP, rng, touches=16)
    for readings in (touches, [-q for q in touches]):
        examined_fit = examine(
            identify(readings, alike), readings, partial(identify, nominal=alike)
        )
        assert examined_fit.doubts == ()
        assert any("mirror image" in line for line in examined_fit.untold)
    assert examined(series, nominal).untold == ()
    assert "manufacturing tolerances are" in doubted([-q for q in series], nominal)


def test_touches_from_a_hull_that_moves_are_doubted_alike() -> None:
    rng = np.random.default_rng(5)
    arm = published_arms.load("ur5")
    longer = on_moving_base(arm, X_BA)
    true = wrong_arm(arm, ERRORS, rng)
    series = []
    for p_A in np.array([[0.4, 0.3, 0.2], [-0.1, 0.5, 0.3], [0.2, -0.4, 0.35]]):
        hulls = [
            pose(exp_so3(0.03 * rng.standard_normal(3)), 0.02 * rng.standard_normal(3))
            for _ in range(16)
        ]
        p_W = transform_points(X_BA, p_A[None])
        goals = np.vstack([transform_points(inverse(X_WB @ X_BA), p_W) for X_WB in hulls])
        read = with_base(np.vstack(touch(true, TIP, rng, points=goals, touches=1)), np.array(hulls))
        read[:, :3] += 7e-4 * rng.standard_normal((16, 3))  # navigation
        series.append(read)
    again = partial(identify, nominal=longer, free=own_parameters(longer))

    def said(given: Series) -> str:
        known = Told(names=NAMES, base_joints=BASE_JOINTS)
        return "; ".join(map(str, examine(again(given), given, again, known).doubts))

    assert said(series) == ""
    assert "joint 2 with the opposite sign" in said(
        [q * np.where(np.arange(12) == 7, -1.0, 1.0) for q in series]
    )
    assert "the same touches were written twice" in said([series[0], series[0], series[2]])
    assert "joint 3 reads +5" in said(
        [series[0], series[1] + np.deg2rad(5.0) * (np.arange(12) == 8), series[2]]
    )


@pytest.mark.parametrize("share", [0.96, 1.04])
def test_a_wrong_length_is_refused_with_its_odds(
    share: float, series: Series, nominal: SerialArm
) -> None:
    words = doubted(series, nominal, share * APART)
    assert f"known distance a to b: stated {share * APART:.5g} m" in words
    assert "to 1)" in words


def test_a_prior_that_the_touches_choose_is_bounded(series: Series, nominal: SerialArm) -> None:
    fit = identify([np.vstack(series[:2])], nominal)
    assert np.all(fit.estimate.prior <= widest_prior(fit.estimate.parameters, nominal.reach))
    assert fit.arm.reach > 0.9 * nominal.reach


def test_touches_of_one_posture_tell_nothing(rng: np.random.Generator) -> None:
    arm = SerialArm.from_dh([[0.3, 0.1, 0.5, 0.2]])
    with pytest.raises(ConfigurationError, match="at least one joint must move by a degree"):
        identify([0.7 + 1e-4 * rng.standard_normal((20, 1))], arm)


def test_thousands_of_touches_settle() -> None:
    """Shifts along parallel axes that cancel would let the arm look larger, and its residuals
    smaller, without end.
    """
    rng = np.random.default_rng(1)
    nominal = published_arms.load("ur10e")
    truth = wrong_arm(
        nominal, {"theta": 2e-3, "d": 5e-4, "a": 5e-4, "alpha": 2e-3, "beta": 2e-3}, rng
    )
    few = touch(truth, TIP, rng, touches=60)
    many = [np.vstack([q + 1e-4 * rng.standard_normal(q.shape) for _ in range(25)]) for q in few]
    fit = identify(many, nominal)
    assert fit.converged
    assert len(fit.history) < 60  # measured 10


def test_touches_coincide_by_the_arm_that_made_them(series: Series, nominal: SerialArm) -> None:
    assert coincide(nominal, series)
    assert not coincide(nominal, columns(0, 1, 4, 3, 2, 5, 6)(series))
    assert not coincide(nominal, [0.01 * q + 0.5 for q in columns(1, 0, 2, 3, 4, 5, 6)(series)])


CANCELLING = """theta,{d},a,alpha
0,0.09,0,1.5703
-1.2,312.4,-0.09,-0.0009
1.7,-271.9,-0.33,0.0031
-0.5,-40.39,0,1.57
"""


@pytest.mark.parametrize("d", ["d", "d [m]", "d_m"])
def test_lengths_that_cancel_are_metres(d: str, tmp_path, within) -> None:
    file = tmp_path / "maker.csv"
    file.write_text(CANCELLING.format(d=d))
    source = read_arm(file)
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    exact = SerialArm(table=np.column_stack([rows, np.zeros(4)]), joint_types="rrrr")
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (10, 4))
    within("flange", source.arm.flange(q) - exact.flange(q), 1e-11)  # 1e-13
    assert source.arm.reach < 2.0
    assert any("cancel" in note for note in source.notes)


def test_a_stated_unit_is_not_overruled(tmp_path) -> None:
    file = tmp_path / "dh.csv"
    file.write_text("theta,d [m],a,alpha\n0,300,0,1.5\n0,0,-600,0\n")
    with pytest.raises(ConfigurationError, match="in millimetres"):
        read_arm(file)
    file.write_text("theta [rad],d,a,alpha\n20,0.3,0,1.5\n0,0,-0.6,0\n")
    with pytest.raises(ConfigurationError, match="in degrees"):
        read_arm(file)
    file.write_text("theta,d [mm],a,alpha\n0,30,0,1.5\n0,0,40,0\n")
    assert read_arm(file).arm.table[1, 2] == pytest.approx(0.04)
