"""What the doors refuse, by name and with the number."""

import re
from typing import Any

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError

NAN = float("nan")
LINE = {"start": np.zeros(3), "end": np.array([1.0, 0.0, 0.0]), "normal": 1.0}
CROSSED = np.eye(6) + np.diag([1.0] * 5, 1)


def ball(options: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(
        f'<mujoco>{options}<worldbody><body name="ball"><freejoint/><geom size=".1" '
        'mass="4"/></body>'
        '<body name="rock"/></worldbody></mujoco>'
    )


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"volume": -1.0}, r"volume \[m\^3\]: must not be negative, got -1.0"),
        ({"volume": NAN}, "volume .* must be finite"),
        ({"center_of_buoyancy": np.zeros(2)}, r"center_of_buoyancy .* shape \(3,\), got \(2,\)"),
        ({"added_mass": CROSSED}, r"added_mass: not symmetric, \[0, 1\] = 1.0, \[1, 0\] = 0.0"),
        ({"added_mass": np.diag([1, 1, -1, 1, 1, 1])}, "added_mass: has a negative eigenvalue, -1"),
        ({"added_mass": np.eye(3)}, r"added_mass: expected shape \(6, 6\), got \(3, 3\)"),
        ({"added_mass": NAN * np.eye(6)}, "added_mass: every number must be finite"),
        ({"linear_damping": -np.ones(6)}, "linear_damping: must not be negative"),
        (
            {"linear_damping": np.ones(5)},
            r"linear_damping: expected shape \(6,\) or \(6, 6\), got "
            r"\(5,\)",
        ),
        (
            {"linear_damping": np.eye(6) - 4 * np.eye(6, k=1)},
            "symmetric part of linear_damping: has a negative",
        ),
        ({"quadratic_damping": -np.ones(6)}, "quadratic_damping: must not be negative"),
        ({"strips": (StripDrag(**LINE),) * 3}, "strips: expected at most 2"),
        ({"strips": ("line",)}, "strips: expected at most 2 StripDrag"),
    ],
)
def test_coefficients_are_checked(given: dict[str, Any], says):
    with pytest.raises(ConfigurationError, match=says):
        BodyHydrodynamics(**{"volume": 1.0, **given})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"end": np.zeros(3)}, "coincide"),
        ({"normal": -1.0}, "normal drag .* must not be negative"),
        ({"tangential": NAN}, "tangential drag .* must be finite"),
        ({"stations": 9}, "expected 1 to 8, got 9"),
        ({"start": np.zeros(4)}, "strip start: expected shape"),
    ],
)
def test_strips_are_checked(given: dict[str, Any], says):
    with pytest.raises(ConfigurationError, match=says):
        StripDrag(**{**LINE, **given})


def test_coefficients_are_private_and_read_only():
    mass = np.eye(6)
    body = BodyHydrodynamics(volume=1.0, added_mass=mass)
    mass[0, 0] = 7.0
    assert body.added_mass[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        body.added_mass[0, 0] = 7.0


def test_coefficients_return_from_the_compiled_model():
    skewed = np.arange(36.0).reshape(6, 6)
    body = BodyHydrodynamics(
        volume=0.1,
        center_of_buoyancy=np.array([1.0, 2.0, 3.0]),
        added_mass=skewed @ skewed.T,
        linear_damping=50.0 * np.eye(6) + 0.1 * (skewed - skewed.T),
        quadratic_damping=np.arange(6.0),
        strips=(StripDrag(**LINE, tangential=0.5, stations=3), StripDrag(**LINE)),
    )
    spec = ball()
    water.attach(spec, {"ball": body})
    back = water.unpack(spec.compile().body("ball").user)
    for name in (
        "volume",
        "center_of_buoyancy",
        "added_mass",
        "linear_damping",
        "quadratic_damping",
    ):
        assert np.array_equal(getattr(back, name), getattr(body, name)), name
    for returned, here in zip(back.segments, body.segments, strict=True):
        assert np.array_equal(returned.end, here.end)
        assert (returned.normal, returned.tangential, returned.stations) == (
            here.normal,
            here.tangential,
            here.stations,
        )


def test_attach_names_what_is_wrong():
    spec = ball()
    body = water.sphere(0.1)
    with pytest.raises(ConfigurationError, match="no such body: 'bal'; the spec has ball, rock"):
        water.attach(spec, {"bal": body})
    with pytest.raises(ConfigurationError, match=r"water_density .* must be positive, got 0"):
        water.attach(spec, {"ball": body}, 0.0)
    with pytest.raises(ConfigurationError, match="ball: must be BodyHydrodynamics, got float"):
        water.attach(spec, {"ball": untyped(1.0)})
    spec.body("ball").userdata = [1.0, 2.0]
    with pytest.raises(ConfigurationError, match="ball: its user data holds other data already"):
        water.attach(spec, {"ball": body})


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: water.sphere(0.0), r"radius \[m\]: must be positive, got \[0.0\]"),
        (
            lambda: water.sphere(0.1, drag_coefficient=-1.0),
            "drag_coefficient: must not be negative, got -1.0",
        ),
        (
            lambda: water.sphere(0.1, water_density=0.0),
            r"water_density .* must be positive, got "
            r"0.0",
        ),
        (
            lambda: water.sphere(0.1, center=[0.0, NAN, 0.0]),
            r"center \[m\]: every number must be "
            r"finite",
        ),
        (
            lambda: water.ellipsoid([1.0, 1e-8, 1.0]),
            "semi_axes .* at least 1e-06 and 1e-06 of the longest",
        ),
        (lambda: water.box([1.0, 1.0]), r"size \[m\]: expected shape \(3,\), got \(2,\)"),
        (lambda: water.box([1.0, 1.0, 1e9]), r"size \[m\]: must not exceed 100000"),
        (lambda: water.cylinder(0.1, [0, 0, 0], [0, 0, 0]), "strip: start .* and end .* coincide"),
        (
            lambda: water.cylinder(0.1, [0, 0, 0], [1, 0, 0], normal_coefficient=NAN),
            "normal_coefficient: every",
        ),
    ],
)
def test_shapes_are_checked(make, says):
    with pytest.raises(ConfigurationError, match=says):
        make()


def test_density_stays_until_another_is_given():
    spec = ball()
    body = water.sphere(0.1)
    water.attach(spec, {"ball": body}, 1000.0)
    water.attach(spec, {"rock": body})
    assert water.density_of(spec) == 1000.0
    water.attach(spec, {}, 1010.0)
    assert hydrodynamics.compile(spec).body_user[1, water.LAYOUT.body_density] == 1010.0


def test_bodies_of_different_waters_are_refused():
    scene = mujoco.MjSpec()
    for name, density in (("sea", 1025.0), ("lake", 1000.0)):
        child = ball()
        water.attach(child, {"ball": water.sphere(0.1)}, density)
        scene.attach(child, prefix=f"{name}/", frame=scene.worldbody.add_frame())
    with pytest.raises(
        ConfigurationError,
        match=r"different densities .* sea/ball 1025, lake/ball "
        r"1000",
    ):
        hydrodynamics.compile(scene)
    water.attach(scene, {}, 1000.0)
    hydrodynamics.compile(scene)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"timestep": 0.0}, "timestep 0 s; it must be positive"),
        ({"gravity": [0.0, 0.0, NAN]}, "gravity .* must be finite"),
        ({"wind": [1e300, 0.0, 0.0]}, r"wind \(the current\) .* must be finite and below"),
    ],
)
def test_options_without_sense_are_refused(change: dict[str, Any], says):
    spec = ball()
    water.attach(spec, {"ball": water.sphere(0.1)})
    for name, setting in change.items():
        setattr(spec.option, name, setting)
    with pytest.raises(HydrodynamicsError, match=says):
        hydrodynamics.compile(spec)


def test_volume_without_mass_is_refused_with_the_number():
    """1 m^3 of buoyancy on 4 kg, and no added mass: 1025 * 9.81 / 4 m/s^2 make 50 m/s in 20 ms, 126
    in 50 ms.
    """
    spec = ball('<option timestep="0.02"/>')
    water.attach(spec, {"ball": BodyHydrodynamics(volume=1.0)})
    hydrodynamics.compile(spec)
    spec.option.timestep = 0.05
    with pytest.raises(
        HydrodynamicsError,
        match=r"bring this model to 126 m/s .* in one step, "
        r"more than 100",
    ):
        hydrodynamics.compile(spec)


def test_set_current_needs_water():
    with pytest.raises(ConfigurationError, match="call attach first"):
        water.set_current(ball(), [1.0, 0.0, 0.0])


def test_trim_names_what_is_wrong():
    spec = ball()
    with pytest.raises(ConfigurationError, match="ball: has no hydrodynamics"):
        water.trim(spec, "ball", metacentric_height=0.1)
    water.attach(spec, {"ball": water.sphere(0.1)})
    with pytest.raises(ConfigurationError, match="metacentric_height"):
        water.trim(spec, "ball", metacentric_height=NAN)
    with pytest.raises(ConfigurationError, match="qpos: expected shape"):
        water.trim(spec, "ball", metacentric_height=0.1, qpos=np.zeros(3))
    child = spec.body("ball").add_body(name="float")
    water.attach(spec, {"float": BodyHydrodynamics(volume=1.0)})
    with pytest.raises(ConfigurationError, match=r"weighs 4 kg, but its other bodies .* 1025 kg"):
        water.trim(spec, "ball", metacentric_height=0.1)
    spec.delete(child)
    spec.option.gravity = [0, 0, 0]
    with pytest.raises(ConfigurationError, match="gravity is zero"):
        water.trim(spec, "ball", metacentric_height=0.1)


@pytest.mark.check("PGS, noslip, sleep, MuJoCo's own fluid", "refused by name")
@pytest.mark.parametrize(
    ("options", "says"),
    [
        ('<option solver="PGS"/>', "solver PGS"),
        ('<option noslip_iterations="3"/>', "noslip_iterations 3"),
        ('<option density="1000"/>', "density 1000.0"),
        ('<option viscosity="0.1"/>', "viscosity 0.1"),
        ('<option><flag sleep="enable"/></option>', "flag sleep"),
        ('<option><flag diagexact="enable"/></option>', "flag diagexact"),
        ('<option><flag spring="disable" damper="disable"/></option>', "spring and damper"),
    ],
)
def test_compile_refuses_what_would_be_wrong(options, says):
    spec = ball(options)
    hydrodynamics.compile(spec)  # without coefficients it is MuJoCo's own affair
    water.attach(spec, {"ball": water.sphere(0.1)})
    with pytest.raises(HydrodynamicsError, match=says):
        hydrodynamics.compile(spec)


def test_check_sees_later_changes():
    spec = ball()
    water.attach(spec, {"ball": water.sphere(0.1)})
    model = hydrodynamics.compile(spec)
    hydrodynamics.check(model)
    model.opt.density = 1000.0
    with pytest.raises(HydrodynamicsError, match="density"):
        hydrodynamics.check(model)


@pytest.mark.check("step too long for the drag", "refused, with the number")
def test_drag_too_strong_for_the_step_is_refused_with_the_number():
    """4 kg and 2 * 2 * 600 N s/m make a rate of 600 1/s: 2 ms is too long by 1.2, 1.6 ms is not."""
    spec = ball()
    body = BodyHydrodynamics(volume=0.0, quadratic_damping=np.array([600.0, 0, 0, 0, 0, 0]))
    water.attach(spec, {"ball": body})
    with pytest.raises(
        HydrodynamicsError,
        match=r"timestep 0.002 s .* 600 1/s, is 1.2, .* at "
        r"most 0.00167 s",
    ):
        hydrodynamics.compile(spec)
    spec.option.timestep = 0.0016
    hydrodynamics.compile(spec)


@pytest.mark.check("rate of strips in that refusal", "4 k L / m, 4 k L^3 / (12 I) at 2 m/s, rad/s")
@pytest.mark.parametrize(
    ("normal", "tangential", "length", "turns"),
    [(9e3, 0.0, 0.1, 0), (30.0, 9e3, 0.1, 0), (3e3, 0.0, 0.8, 1)],
)
def test_drag_of_strips_too_strong_for_the_step_is_refused(
    normal, tangential, length, turns, within
):
    """A strip through the middle of the ball: across, along, and where it is long, turning."""
    spec = ball()
    end = np.array([0.5 * length, 0.0, 0.0])
    strip = StripDrag(start=-end, end=end, normal=normal, tangential=tangential)
    water.attach(spec, {"ball": BodyHydrodynamics(volume=0.0, strips=strip)})
    inertia = 0.4 * 4.0 * 0.1**2
    rate = (
        4.0 * normal * length**3 / 12.0 / inertia
        if turns
        else 4.0 * max(normal, tangential) * length / 4.0
    )
    spec.option.timestep = 1.01 / rate
    with pytest.raises(HydrodynamicsError, match="the rate of the drag") as refusal:
        hydrodynamics.compile(spec)
    (printed,) = re.findall(r"([\d.e+]+) 1/s", str(refusal.value))
    within("relative rate", float(printed) / rate - 1.0, 5e-4)  # printed with four digits
    spec.option.timestep = 0.99 / rate
    hydrodynamics.compile(spec)
