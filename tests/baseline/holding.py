"""One test for all files of the baseline: a case's figures at its first seed lie within their bands."""

import store
from bands import faults
from cases import CASES

SEED = 0


def check(name: str) -> None:
    said = faults(CASES[name](SEED), store.read()[name])
    assert not said, "\n".join(
        [f"{name}, seed {SEED}: outside the band of the behaviour baseline, better or worse", *said,
         "if this is meant: ./uvw run tests/baseline/record.py --reason ..."]
    )  # fmt: skip
