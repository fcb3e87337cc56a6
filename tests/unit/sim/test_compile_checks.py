"""What is no number, no spec or no mapping is refused where it is given, in one line."""

# pyright: reportArgumentType=false

from typing import Any

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.models import hydrodynamics as water
from uuv.models.files.sidecar import xml_with_elements
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import checked, checked_pose, exp_so3, fitting, pose
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

SPOILT: list[Any] = [
    [1.0, 2.0],
    [1.0, 2.0, np.nan],
    [1.0, 2.0, np.inf],
    ["1", "2", "3"],
    np.array([1.0, 2.0, 3.0j]),
    [1j, 0, 0],
    [None, 0.0, 0.0],
    np.zeros(3, dtype="datetime64[s]"),
    "abc",
    None,
]


@pytest.mark.parametrize("values", SPOILT, ids=repr)
@pytest.mark.parametrize("check", [checked, fitting])
def test_what_is_no_vector_of_real_numbers(check, values):
    with pytest.raises(ConfigurationError, match=r"^wind: "):
        check(values, (3,), "wind")


def test_water_in_elements_that_mujoco_alone_has_read_is_refused(tmp_path):
    """The file of a wet vehicle, read without the project's reader, would sink as in a vacuum."""
    file = tmp_path / "wet.xml"
    file.write_text(xml_with_elements(models.load("bluerov2_heavy")))
    message = r"custom element 'water/\S+' holds water .* uuv\.own_vehicle\.vehicle_spec"
    spec = mujoco.MjSpec.from_file(str(file))
    with pytest.raises(ConfigurationError, match=message):
        hydrodynamics.compile(spec)
    with pytest.raises(ConfigurationError, match=message):
        Plant(mujoco.MjModel.from_xml_path(str(file)), current=Current(np.zeros(3)))

    read = hydrodynamics.compile(vehicle_spec(str(file)))
    assert np.array_equal(
        read.body_user, hydrodynamics.compile(models.load("bluerov2_heavy")).body_user
    )


def test_only_what_fits_goes_through_as_it_is():
    plain = np.array([1e200, -2.0, 3.0])  # its square is beyond the largest number
    assert np.array_equal(fitting(plain, (3,), "wind"), plain)
    small = plain[1:].copy()
    assert fitting(small, (2,), "wind") is small
    for other in ([-2, 3], np.array([-2, 3]), np.array([-2.0, 3.0], dtype=">f8")):
        got = fitting(untyped(other), (2,), "wind")
        assert got.dtype is np.dtype(np.float64)
        assert np.array_equal(got, small)


@pytest.mark.parametrize(
    "X",
    [
        np.diag([1.0, 1.0, -1.0, 1.0]),
        2.0 * np.eye(4),
        np.eye(4) + np.eye(4, k=-3),
        np.zeros((4, 4)),
    ],
)
def test_what_is_no_pose(X):
    with pytest.raises(ConfigurationError, match=r"^X_WB: expected a pose"):
        checked_pose(X, "X_WB")
    turned = pose(exp_so3([0.3, -2.0, 1.0]), [1e6, 0.0, -4e3])
    assert np.array_equal(checked_pose(turned.tolist(), "X_WB"), turned)


def wet_ball() -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="hull"><freejoint/><geom size=".1" '
        'mass="4"/></body></worldbody></mujoco>'
    )
    water.attach(spec, {"hull": water.sphere(0.1)})
    return spec


@pytest.mark.parametrize(
    ("act", "says"),
    [
        (
            lambda spec: water.attach(spec, ["hull"]),
            r"bodies: expected a mapping .* got \['hull'\]",
        ),
        (lambda spec: water.attach(spec, None), "bodies: expected a mapping .* got None"),
        (lambda spec: water.attach(spec, {}, "1025"), "water_density: expected"),
        (
            lambda spec: water.attach(spec.compile(), {}),
            "spec: expected a mujoco.MjSpec, .* got <mujoco",
        ),
        (lambda spec: water.set_current(spec.compile()), "spec: expected a mujoco.MjSpec"),
        (
            lambda spec: water.trim(spec.compile(), "hull", metacentric_height=0.1),
            "spec: expected a mujoco.MjSpec",
        ),
        (
            lambda spec: water.trim(spec, "hull", metacentric_height="a"),
            r"metacentric_height \[m\]: expected",
        ),
        (
            lambda spec: hydrodynamics.compile(spec.compile()),
            "compile: expected a mujoco.MjSpec, got <mujoco",
        ),
        (
            lambda spec: hydrodynamics.compile(spec.to_xml()),
            "compile: expected a mujoco.MjSpec, got '<mujoco",
        ),
    ],
)
def test_what_is_no_spec_mapping_or_number(act, says):
    with pytest.raises(ConfigurationError, match=says):
        act(wet_ball())
