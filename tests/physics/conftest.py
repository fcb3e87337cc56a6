"""Every physics test runs with the callback installed; random ones run with fixed seeds and a fresh one."""

import os
from collections.abc import Iterator

import numpy as np
import pytest

from sim import hydrodynamics


@pytest.fixture(autouse=True)
def installed() -> Iterator[None]:
    hydrodynamics.install()
    yield
    hydrodynamics.uninstall()


@pytest.fixture(params=[1, 2, 3, "fresh"])
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Three fixed seeds and one that is new in every run; pytest shows it when the test fails."""
    seed = int.from_bytes(os.urandom(4), "big") if request.param == "fresh" else request.param
    print(f"seed {seed}")
    return np.random.default_rng(seed)
