"""What is worked out of a wet model before it moves: inertia, drag rates, ancestors, settings that
are refused.
"""

from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import LAYOUT, BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.spatial import exp_so3, quat_wxyz_from_rotation

BOX = (0.1, 0.2, 0.4)  # [m] half sizes


def block(**coefficients: Any) -> mujoco.MjSpec:
    """A free block of 8 kg and its coefficients."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, -9.81]
    body = spec.worldbody.add_body(name="block")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=BOX, mass=8.0)
    water.attach(spec, {"block": BodyHydrodynamics(volume=0.008, **coefficients)}, 1000.0)
    return spec


def rates(**coefficients: Any) -> tuple[float, float]:
    """Drag rate [1/s] at rest, and its growth [1/m] with speed, as written into the model."""
    model = hydrodynamics.compile(block(**coefficients))
    return tuple(model.body_user[0][LAYOUT.drag_rate :][:2])


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.1, -0.2, 0.3)])
def test_largest_inertia_is_about_the_origin(place: tuple[float, float, float]) -> None:
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="block")
    body.add_freejoint()
    R = exp_so3([0.3, -0.4, 0.5])
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=BOX,
        mass=8.0,
        pos=place,
        quat=quat_wxyz_from_rotation(R),
    )
    model = spec.compile()
    a, b, c = np.square(BOX)
    about_center = R @ np.diag(8.0 / 3.0 * np.array([b + c, a + c, a + b])) @ R.T
    p = np.array(place)
    expected = np.linalg.eigvalsh(about_center + 8.0 * (p @ p * np.eye(3) - np.outer(p, p)))
    assert expected[-1] > 1.01 * expected[1]
    assert hydrodynamics._largest_inertia(model, 1) == pytest.approx(expected[-1])


def test_drag_rates_are_damping_over_inertia_with_the_waters() -> None:
    """A rate at rest by linear damping, and one that grows with speed by quadratic drag."""
    added = np.diag([2.0, 4.0, 8.0, 1.0, 1.0, 1.0])
    still, growth = rates(added_mass=added, linear_damping=[3.0, 30.0, 3.0, 0.0, 0.0, 0.0])
    assert still == pytest.approx(30.0 / (8.0 + 4.0))
    assert growth == pytest.approx(0.0, abs=1e-12)
    still, growth = rates(added_mass=added, quadratic_damping=[3.0, 30.0, 3.0, 0.0, 0.0, 0.0])
    assert still == pytest.approx(0.0, abs=1e-12)
    assert growth == pytest.approx(2.0 * 30.0 / (8.0 + 4.0))
    both = {
        "linear_damping": [0.0, 6.0, 0.0, 0.0, 0.0, 0.0],
        "quadratic_damping": [0.0, 30.0, 0.0, 0.0, 0.0, 0.0],
    }
    still, growth = rates(added_mass=added, **both)
    assert still + growth * hydrodynamics.DRAG_SPEED == pytest.approx(
        (6.0 + 2.0 * 2.0 * 30.0) / 12.0
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"viscosity": 0.001}, "viscosity 0.001"),
        ({"density": 1000.0}, "density 1000"),
        ({"noslip_iterations": 1}, "noslip_iterations 1"),
        ({"solver": mujoco.mjtSolver.mjSOL_PGS}, "PGS"),
        ({"gravity": [0.0, 0.0, np.nan]}, "gravity"),
    ],
)
def test_settings_that_would_be_wrong_are_refused(change: dict, said: str) -> None:
    model = hydrodynamics.compile(block())
    assert hydrodynamics._refused(model) == []
    for name, setting in change.items():
        setattr(model.opt, name, setting)
    (refused,) = hydrodynamics._refused(model)
    assert said in refused
    spec = block()
    for name, setting in change.items():
        setattr(spec.option, name, setting)
    with pytest.raises(HydrodynamicsError, match=said.replace(".", r"\.")):
        hydrodynamics.compile(spec)


def lever(scale: float, name: str, ratio: float) -> list[str]:
    """What is said of a ball of the radius `scale`, of the density of water, with angular over
    linear as given.
    """
    power = 3 if name == "quadratic_damping" else 2
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="ball")
    body.add_freejoint()
    volume = 4.0 / 3.0 * np.pi * scale**3
    body.add_geom(size=[scale, 0, 0], density=1000.0)
    linear = 10.0 * volume  # any size, but little against the inertia
    diagonal = np.array([linear] * 3 + [ratio * linear * (np.sqrt(0.4) * scale) ** power] * 3)
    coefficients: dict[str, Any] = {name: np.diag(diagonal) if name == "added_mass" else diagonal}
    water.attach(spec, {"ball": BodyHydrodynamics(volume=volume, **coefficients)}, 1000.0)
    return hydrodynamics.doubts(spec.compile())


@pytest.mark.parametrize("name", ["added_mass", "linear_damping", "quadratic_damping"])
@pytest.mark.parametrize("scale", [0.1, 0.5, 3.0])
def test_doubt_of_coefficients_does_not_depend_on_the_scale(name: str, scale: float) -> None:
    most = hydrodynamics._LEVERS[name][1]
    assert not any(name in doubt for doubt in lever(scale, name, 0.9 * most))
    assert any(name in doubt for doubt in lever(scale, name, 1.1 * most))
