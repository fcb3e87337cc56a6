"""Every physics test runs with the callback installed.

`@pytest.mark.check(name, reference)` puts a test on the validation page: `uuv validate` runs those
tests and shows one line for each name. What `within` was given travels there in the test's report.
"""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import PhysicsWarning


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "check(name, reference): a line of the validation page")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Equations are tested on bodies that nobody could build; what is said of those has tests of
    its own.
    """
    for test in items:
        if Path(__file__).parent in test.path.parents:
            test.add_marker(
                pytest.mark.filterwarnings(
                    f"ignore::{PhysicsWarning.__module__}.{PhysicsWarning.__name__}"
                )
            )


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
        request.node.user_properties.append(("within", (name, largest, float(tolerance))))
        within(name, residual, tolerance)

    return check
