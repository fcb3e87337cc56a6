"""Every physics test runs with the callback installed.

`@pytest.mark.check(name, reference)` puts a test on the validation page: `scripts/validate_physics.py` runs those tests
and shows one line for each name. What `within` was given travels there in the test's report.
"""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from sim import hydrodynamics


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "check(name, reference): a line of the validation page")


@pytest.fixture(autouse=True)
def installed() -> Iterator[None]:
    hydrodynamics.install()
    yield
    hydrodynamics.uninstall()


@pytest.fixture
def within(
    within: Callable[[str, object, float], None], request: pytest.FixtureRequest
) -> Callable[[str, object, float], None]:
    """The one of every test, which also leaves its figures in the test's report."""

    def check(name: str, residual: object, tolerance: float) -> None:
        largest = float(np.max(np.abs(np.asarray(residual, dtype=np.float64))))
        request.node.user_properties.append(("within", (name, largest, tolerance)))
        within(name, residual, tolerance)

    return check
