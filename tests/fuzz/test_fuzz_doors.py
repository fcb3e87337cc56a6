"""Every door against thousands of odd inputs: a whole, finite result, or one line of ours.

No other error, no hang.

    # as many of each door, in place of a few
    UUV_FUZZ=500 ./uvw run pytest tests/fuzz

    # a new seed, which a finding tells
    UUV_FUZZ=500 UUV_FUZZ_SEED=fresh ./uvw run pytest tests/fuzz

A finding names the call that repeats it. What was found before is in `corpus/`, and in PAST below.
"""

import contextlib
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fuzz_doors
import numpy as np
import pytest
from fuzz_doors import DOORS, VALID, Door, FindingError, Hostile, attempt

from untyped import untyped
from uuv.calib import Arm, MapFit
from uuv.calib import identify as calibrate
from uuv.controllers.mkps import Chain, IkOptions, solve
from uuv.models.arms import published_arms
from uuv.models.objects import targets
from uuv.models.objects.targets import TargetModel
from uuv.perception.toolpath.path_shapes import line, raster
from uuv.sim.interfaces.errors import LONGEST, ConfigurationError, UuvError

INPUTS = int(os.environ.get("UUV_FUZZ", "12"))
_ASKED = os.environ.get("UUV_FUZZ_SEED", "0")
SEED = int.from_bytes(os.urandom(4), "big") if _ASKED == "fresh" else int(_ASKED)
CORPUS = Path(__file__).parent / "corpus"
DH = [[0.0, 0.3, 0.0, 1.57], [0.0, 0.0, 0.4, 0.0], [0.1, 0.0, 0.3, 0.2]]
CHAIN = Chain.from_dh(published_arms.load("puma560").dh)
PUMA = fuzz_doors._PUMA
TOUCHES = [np.random.default_rng(k).uniform(-1.0, 1.0, (6, 3)) for k in range(2)]


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door.name)
def test_what_is_thrown_is_met(door: Door) -> None:
    became: list[str] = []
    for number in range(max(2, round(door.share * INPUTS))):
        try:
            became.append(attempt(door, SEED, number))
        except FindingError as finding:
            pytest.fail(
                f"./uvw run tests/fuzz/fuzz_doors.py --inputs 1 --seed {SEED} --first {number} "
                f"--door {door.name!r}: "
                f"{finding}"
            )
    print(door.name, sum(outcome == "passed" for outcome in became), "of", len(became), "passed")


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="the system has no timers")
def test_what_takes_too_long_is_a_finding_whatever_catches_exceptions(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def slow(_rng: np.random.Generator, _folder: Path) -> None:
        with contextlib.suppress(Exception):
            time.sleep(5.0)

    monkeypatch.setattr(fuzz_doors, "LONGEST", 0.05)
    with pytest.raises(FindingError, match=r"more than 0\.05 s"):
        attempt(Door("slow", slow), 0, 0)


@pytest.mark.parametrize("kind", sorted(VALID))
def test_valid_files_pass(kind: str, tmp_path: Path) -> None:
    for name, raw in VALID[kind].items():
        (tmp_path / name).write_bytes(raw)
        try:
            fuzz_doors.whole(fuzz_doors.give(kind, tmp_path / name))
        except UuvError as error:
            pytest.fail(f"{kind} {name}: {error}")


@pytest.mark.parametrize(
    "file", sorted(CORPUS.glob("*/*")), ids=lambda file: f"{file.parent.name}-{file.name}"
)
def test_files_that_were_met_badly_are_refused_by_name(file: Path) -> None:
    """The name of each ends in two words of the answer: `what-it-is.WORDS.ending`."""
    words = file.suffixes[0].strip(".").replace("_", " ")
    with pytest.raises(ConfigurationError) as refused:
        fuzz_doors.give(file.parent.name, file)
    message = str(refused.value)
    assert words in message
    assert len(message) <= LONGEST
    assert message.isprintable()


PAST: list[tuple[Callable[[], Any], str]] = [
    (lambda: Chain.from_mjcf(PUMA, untyped(None), "tip"), "base_body: expected a name, got None"),
    (lambda: Chain.from_dh(DH, joint_types=untyped(7)), "joint_types: expected 3 letters"),
    (lambda: Chain.from_dh([[1e308, 0, 0, 0]]), "dh: numbers must lie within 1e"),
    (lambda: Chain.from_dh([[10**400, 0, 0, 0]]), "dh: expected .* numbers"),
    (lambda: Chain.from_urdf(untyped(np.zeros(2)), "a", "b"), "base_link|urdf: expected"),
    (lambda: Arm.from_dh(DH, joint_types=untyped(7)), "joint_types: expected 3 letters"),
    (lambda: Arm.from_dh([["a"] * 4]), "dh: expected"),
    (lambda: IkOptions(max_restarts=10**400), "max_restarts: must be a whole number"),
    (lambda: solve(CHAIN, np.eye(4), []), "q0: expected shape"),
    (lambda: solve(CHAIN, np.eye(4), np.zeros(6), method=untyped(np.zeros(3))), "method: allowed"),
    (
        lambda: solve(CHAIN, np.eye(4), np.zeros(6), position_tolerance=untyped("x")),
        "position_tolerance",
    ),
    (lambda: MapFit(noise=untyped("x")), "noise .m.: expected a number, got 'x'"),
    (lambda: MapFit(noise=1e-296), "noise .m.: must be finite, >= 1e-09"),
    (lambda: MapFit(noise=10**400), "noise .m.: expected a number"),
    (lambda: MapFit(robust=untyped(np.zeros(2))), "robust: must be True or False"),
    (lambda: calibrate(TOUCHES, DH, distances=untyped([(0, 1)])), "distances: expected"),
    (
        lambda: TargetModel.from_file(__file__, scale=untyped("1")),
        "scale: expected a number, got '1'",
    ),
    (lambda: TargetModel.from_file("n" * 300 + ".stl"), "file name too long"),
    (lambda: TargetModel.from_file(untyped(10**400)), "expected the name of a file"),
    (lambda: targets.of(untyped(1j)), "object: expected a name or a mesh file"),
    (lambda: targets.of(untyped(Hostile())), "object: expected .*Hostile"),
    (lambda: line([0, 0, 0], [1e300, 0, 0]), "line: end: must be within"),
    (lambda: raster([0, 0, 0], [1, 0, 0], [0, 1, 0], untyped("x")), "pitch .m.: expected a number"),
    (lambda: raster([0, 0, 0], [1, 0, 0], [0, 1, 0], 1e-9), "at most 10000 lines"),
]


@pytest.mark.parametrize("number", range(len(PAST)), ids=lambda k: PAST[k][1][:30])
def test_arguments_that_were_met_badly_are_refused_by_name(number: int) -> None:
    call, words = PAST[number]
    with pytest.raises(ConfigurationError, match=words) as refused:
        call()
    assert len(str(refused.value)) <= LONGEST
