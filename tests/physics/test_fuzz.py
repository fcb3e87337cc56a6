"""Malformed coefficients and models: each either works, or is refused by our own error. No crash,
no NaN, no hang.

`UUV_FUZZ=2000 ./uvw run pytest tests/physics/test_fuzz.py` runs as many cases for each seed.
"""

import os
import warnings
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import UuvError

CASES = int(os.environ.get("UUV_FUZZ", "60"))
BAD_NUMBERS: list[Any] = [
    float("nan"),
    float("inf"),
    -float("inf"),
    -1.0,
    -1e-12,
    1e300,
    1e18,
    1e-300,
    10**400,
]
BAD_THINGS: list[Any] = [
    None,
    "much",
    "nan",
    [],
    [[]],
    {},
    [1, "a"],
    [[1, 2], [3]],
    object(),
    1j,
    True,
    np.zeros((0, 6)),
]


def wrong(rng: np.random.Generator, value: Any) -> Any:
    """`value` with something done to it; sometimes it stays good."""
    kind = rng.integers(8)
    if kind == 0 or isinstance(value, tuple):
        return BAD_THINGS[rng.integers(len(BAD_THINGS))]
    array = np.array(value, dtype=object if kind == 1 else np.float64)
    if kind == 1 and array.size:
        array.flat[rng.integers(array.size)] = BAD_NUMBERS[rng.integers(len(BAD_NUMBERS))]
    elif kind == 2:
        array = array * 10.0 ** rng.uniform(-300.0, 300.0)
    elif kind == 3:
        array = rng.normal(size=array.shape) * 10.0 ** rng.integers(-12, 13)
    elif kind == 4:
        array = np.ones(
            [(), (1,), (3,), (5,), (6,), (7,), (3, 3), (6, 6), (6, 7), (6, 6, 1)][rng.integers(10)]
        )
    elif kind == 5:
        array = -array
    elif kind == 6:
        array = array * 10.0 ** rng.integers(-9, 10)
    return array.tolist() if rng.random() < 0.5 or array.ndim == 0 else array


def some(rng: np.random.Generator, given: dict[str, Any], odds: float) -> dict[str, Any]:
    return {
        name: wrong(rng, argument) if rng.random() < odds else argument
        for name, argument in given.items()
    }


def strip(rng: np.random.Generator, odds: float) -> Any:
    numbers = {
        "start": rng.normal(size=3),
        "end": rng.normal(size=3),
        "normal": 2.0,
        "tangential": 0.1,
        "stations": 3,
    }
    return StripDrag(**some(rng, numbers, odds))


def body(rng: np.random.Generator) -> BodyHydrodynamics:
    """By coefficients or by shape."""
    L = rng.normal(size=(6, 6))
    turn = rng.normal(size=(6, 6))
    odds = 0.04
    size = rng.uniform(0.02, 0.5, 3)
    shapes: list[tuple[Callable[..., BodyHydrodynamics], dict[str, Any]]] = [
        (water.sphere, {"radius": size[0], "center": np.zeros(3)}),
        (water.ellipsoid, {"semi_axes": size, "center": 0.1 * size, "drag_coefficient": 0.4}),
        (water.box, {"size": size, "center": 0.1 * size, "water_density": 1000.0}),
        (water.cylinder, {"radius": 0.05, "start": np.zeros(3), "end": size, "stations": 4}),
    ]
    if (which := rng.integers(8)) < 4:
        make, arguments = shapes[which]
        return make(**some(rng, arguments, odds))
    arguments = {
        "volume": 0.004,
        "center_of_buoyancy": 0.1 * rng.normal(size=3),
        "added_mass": L @ L.T,
        "linear_damping": rng.uniform(size=6)
        if rng.random() < 0.5
        else 3.0 * np.eye(6) + turn - turn.T,
        "quadratic_damping": rng.uniform(size=6),
        "strips": tuple(
            strip(rng, 0.02) for _ in range(rng.integers(2 + (rng.random() < 0.05) * 2))
        ),
    }
    return BodyHydrodynamics(**some(rng, arguments, odds))


def tree(rng: np.random.Generator) -> mujoco.MjSpec:
    """A world of 1 to 8 bodies on any joints, with masses over twelve decades, and odd options now
    and then.
    """
    spec = mujoco.MjSpec()
    bodies = [spec.worldbody]
    for i in range(rng.integers(1, 9)):
        parent = bodies[rng.integers(len(bodies))]
        new = parent.add_body(name=f"b{i}", pos=rng.normal(size=3), quat=rng.normal(size=4))
        mass = 10.0 ** (rng.uniform(-6.0, 6.0) if rng.random() < 0.1 else rng.uniform(-1.0, 2.0))
        new.add_geom(size=[0.1, 0.1, 0.1], mass=mass, contype=int(rng.integers(2)))
        free = parent is spec.worldbody and rng.random() < 0.6
        kinds = (
            ["FREE"]
            if free
            else [["HINGE"], ["SLIDE"], ["BALL"], ["HINGE", "SLIDE"], []][rng.integers(5)]
        )
        for kind in kinds:
            new.add_joint(type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"), axis=rng.normal(size=3))
        bodies.append(new)
    if rng.random() < 0.3:
        spec.worldbody.add_body(name="ghost", mocap=True).add_geom(size=[0.1, 0.1, 0.1])
    option = spec.option
    option.integrator = mujoco.mjtIntegrator(int(rng.integers(4)))
    if rng.random() < 0.2:
        names: dict[str, list[Any]] = {
            "timestep": [0.0, -0.001, 0.02, 1.0, 1e9, np.nan],
            "gravity": [[0, 0, 0], [0, 0, 1e30], [np.nan, 0, 0]],
            "wind": [[1e3, 0, 0], [np.inf, 0, 0], [1e200, 0, 0]],
            "density": [1000.0, -1.0, np.nan],
            "viscosity": [0.1, np.nan],
            "solver": [mujoco.mjtSolver.mjSOL_PGS, mujoco.mjtSolver.mjSOL_CG],
            "noslip_iterations": [3],
            "enableflags": [int(mujoco.mjtEnableBit.mjENBL_SLEEP)],
        }
        name = list(names)[rng.integers(len(names))]
        setattr(option, name, names[name][rng.integers(len(names[name]))])
    return spec


def attempt(rng: np.random.Generator) -> str:
    """One case: the name of our error, or what became of the run. Anything else is raised."""
    spec = tree(rng)
    try:
        plain = spec.copy().compile()
        mujoco.mj_step(plain, mujoco.MjData(plain))
    except (ValueError, mujoco.FatalError):
        return "refused by MuJoCo itself"
    try:
        coefficients = {child.name: body(rng) for child in spec.bodies[1:] if rng.random() < 0.8}
        if rng.random() < 0.03:
            coefficients["nobody"] = water.sphere(0.1)
        water.attach(spec, coefficients, *([wrong(rng, 1025.0)] if rng.random() < 0.1 else []))
        if rng.random() < 0.3:
            flow = {
                "velocity": rng.normal(size=3),
                "acceleration": rng.normal(size=3),
                "shear": rng.normal(size=3),
            }
            water.set_current(spec, **some(rng, flow, 0.1))
        model = hydrodynamics.compile(spec)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        assert np.all(np.isfinite(data.qacc)), data.qacc
        assert hydrodynamics.check_installed(model)
        mujoco.mj_step(model, data, 20)
        hydrodynamics.check_motion(model, data)
    except UuvError as error:
        return type(error).__name__
    assert np.all(np.isfinite(np.concatenate([data.qpos, data.qvel, data.qacc, data.qfrc_passive])))
    return "runs"


def test_malformed_coefficients_and_models(rng, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo's log of what blew up
    seed = int(rng.integers(2**31))
    became: dict[str, int] = {}
    for case in range(CASES):
        print(f"case [{seed}, {case}]")
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            outcome = attempt(np.random.default_rng([seed, case]))
        became[outcome] = became.get(outcome, 0) + 1
    print(became)
    assert became["runs"] > 0.1 * CASES
    assert became["ConfigurationError"] > 0.1 * CASES


@pytest.mark.parametrize("strange", [np.nan, np.inf, -5.0, 1e300, 7e8])
def test_spoilt_rows_of_a_compiled_model(strange):
    """Numbers written into the table behind the door's back: `check` refuses, and the callback
    survives.
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="ball"><freejoint/><geom size=".1" '
        'mass="4"/></body></worldbody></mujoco>'
    )
    line = StripDrag(start=np.zeros(3), end=np.ones(3), normal=1.0)
    water.attach(spec, {"ball": BodyHydrodynamics(volume=0.004, added_mass=np.eye(6), strips=line)})
    model = hydrodynamics.compile(spec)
    good = model.body_user[1].copy()
    slots = water.LAYOUT
    for slot in range(1, slots.strips + slots.strip_size):
        model.body_user[1] = good
        model.body_user[1, slot] = strange
        data = mujoco.MjData(model)
        data.qvel[:] = 1.0
        mujoco.mj_forward(model, data)
        if not np.all(np.isfinite(data.qacc)):
            with pytest.raises(UuvError):
                hydrodynamics.check(model)
