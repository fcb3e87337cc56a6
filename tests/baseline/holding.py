"""One test for all files of the baseline: a case's figures at its first seed, or fresh ones, lie
within their bands.
"""

from collections.abc import Sequence

import store
from bands import faults
from cases import CASES

SEED = 0


def check(name: str, fresh_seeds: Sequence[int]) -> None:
    """Fail with a line for each figure outside its band; at `fresh_seeds` where there are any."""
    breaches = []
    for seed in fresh_seeds or (SEED,):
        breaches += [
            f"{name}, seed {seed}: {line}"
            for line in faults(CASES[name](seed), store.read()[name], fresh=seed != SEED)
        ]
    advice = (
        "outside the band, better or worse; if meant: ./uvw run tests/baseline/record.py "
        "--reason ..."
    )
    assert not breaches, "\n".join([advice, *breaches])
