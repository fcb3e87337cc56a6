"""The object's wake in a scenario: where it is, what it takes from the current, and sites without
one.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv.assembly import assemble
from uuv.jobs import clean_barrel, identify_friction
from uuv.perturbations.wake import Wake
from uuv.scenario_file import read_scenario, write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose
from uuv.sim.water.current import Current
from uuv.sim.water.cylinder_wake import CylinderWake

CURRENT = (0.06, 0.24, 0.0)  # [m/s]
X_WT = pose(exp_so3([0.0, 0.0, 0.4]), [0.1, -0.2, -1.6])


def scenario(*perturbations: Wake, current: tuple[float, float, float] = CURRENT):
    plain = clean_barrel(quick=True)
    placed = tuple(tuple(row) for row in X_WT.tolist())
    return replace(
        plain,
        site=replace(plain.site, X_WT=placed, current=current, gust=0.0),
        perturbations=perturbations,
    )


def wake_of(perturbation: Wake) -> CylinderWake:
    (wake,) = assemble(scenario(perturbation)).current().flows
    assert not isinstance(wake, CylinderWake)  # the plant places it
    built = assemble(scenario(perturbation))
    current = built.current()
    current.place(built.plant.model)
    (wake,) = current.flows
    assert isinstance(wake, CylinderWake)
    return wake


def test_the_barrel_sheds_a_wake_of_its_own_size():
    """It lies along x_T, 0.9 m long and 0.6 m thick, on a stand that reaches 0.09 m farther on the
    mean.
    """
    wake = wake_of(Wake())
    np.testing.assert_allclose(wake.axis, X_WT[:3, 0], atol=1e-12)
    assert (wake.stream, wake.length) == (CURRENT, pytest.approx(0.9))
    assert wake.diameter == pytest.approx(0.69)
    np.testing.assert_allclose(wake.place[:2], X_WT[:2, 3], atol=1e-6)
    assert wake_of(Wake(diameter=0.6, drag=0.9)) == replace(wake, diameter=0.6, drag=0.9)


def test_the_plant_is_in_the_wake_where_its_hull_is():
    behind = X_WT[:3, 3] + 1.2 * X_WT[:3, 1]
    built = assemble(scenario(Wake()))
    # it begins beside the wake
    np.testing.assert_allclose(built.plant.truth.current_W, CURRENT, atol=5e-3)
    built.plant.reset(current=built.current(), X_WB=pose(None, behind))
    expected = np.array(CURRENT) + wake_of(Wake()).velocity(behind, 0.0)
    np.testing.assert_allclose(built.plant.truth.current_W, expected, atol=1e-12)
    assert np.linalg.norm(expected) < 0.8 * np.linalg.norm(CURRENT)


def test_it_is_kept_in_a_file(tmp_path):
    written = scenario(Wake(diameter=0.5))
    write_scenario(written, tmp_path / "scenario.toml")
    assert 'kind = "Wake"' in (tmp_path / "scenario.toml").read_text()
    assert read_scenario(tmp_path / "scenario.toml") == written


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: assemble(scenario(Wake(), current=(0.0, 0.0, 0.0))),
            r"Wake: needs a steady current",
        ),
        (
            lambda: assemble(replace(identify_friction(quick=True), perturbations=(Wake(),))),
            "Wake: needs an object, but this site has none",
        ),
        (lambda: Wake(diameter=-0.1), r"Wake diameter \[m\]"),
        (lambda: Wake(drag=np.nan), "Wake drag"),
        (
            lambda: Wake().on_water(Current(CURRENT)).at(np.zeros(3), 0.0),
            "before a plant has placed it",
        ),
    ],
)
def test_refusals(make, said):
    with pytest.raises(ConfigurationError, match=said):
        make()
