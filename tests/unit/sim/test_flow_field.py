"""Flow fields on top of the current: sums, the acceleration along the water's path, and what the
doors refuse.
"""

from copy import deepcopy
from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.models.hydrodynamics import BodyHydrodynamics, attach
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.plant.faults import changing
from uuv.sim.plant.onset import Onset
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current, Wave
from uuv.sim.water.flow_field import FlowField

AXES = exp_so3([0.3, -0.5, 0.8])  # of the linear flow, askew to the world
MEAN = (0.15, -0.05, 0.02)  # [m/s]
P_W = np.array([1.4, -1.7, -2.1])  # [m]
REST = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)


@dataclass(frozen=True, kw_only=True)
class Linear(FlowField):
    """Velocity that grows with the place, and with time by `rate` [1/s]."""

    gradient: tuple[tuple[float, ...], ...]  # [1/s] in `AXES`
    rate: float = 0.0

    def matrix(self) -> Array:
        return AXES @ np.array(self.gradient) @ AXES.T

    def velocity(self, p_W: Array, time: float) -> Array:
        return (1.0 + self.rate * time) * self.matrix() @ p_W


@dataclass
class Given:
    """No child of FlowField: it has the method."""

    value: object

    def velocity(self, p_W, time):
        del p_W, time
        return self.value


STRAIN = Linear(gradient=((0.3, 0.0, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, -0.1)), rate=0.05)
# 0.4 rad/s about the third axis
TURNING = Linear(gradient=((0.0, -0.4, 0.0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.0)))


def test_the_field_is_added_to_current_wave_and_gusts():
    def current() -> Current:
        rng = np.random.default_rng(3)
        return Current(
            MEAN, gust=0.04, wave=Wave(amplitude_W=(0.1, 0.0, -0.05)), timestep=0.01, rng=rng
        )

    alone = current()
    with_field = current().with_flow(STRAIN).with_flow(untyped(Given([0.0, 0.3, 0.0])))
    for tick in range(5):
        velocity, _ = alone.step()
        expected = velocity + STRAIN.velocity(P_W, 0.01 * tick) + [0.0, 0.3, 0.0]
        np.testing.assert_allclose(with_field.at(P_W, 0.01 * tick)[0], expected, atol=1e-15)


@pytest.mark.parametrize("time", [0.0, 2.0])
def test_the_acceleration_is_that_along_the_path_of_the_water(time, within):
    """Of u = (1 + r t) A p, carried by a current c: r A p + (1 + r t) A (c + u); at the start by
    one side only.
    """
    velocity, acceleration = Current(MEAN).with_flow(STRAIN).at(P_W, time)
    grown = 1.0 + STRAIN.rate * time
    A = STRAIN.matrix()
    expected = STRAIN.rate * A @ P_W + grown * A @ velocity
    assert np.abs(expected).max() > 0.05
    # 5e-6, 6e-14
    within("acceleration [m/s^2]", acceleration - expected, 5e-5 if time == 0.0 else 1e-12)


def test_a_profile_is_on_the_field_too(within):
    """Numerical derivative of the velocity at a place that goes with the water."""
    ramp = changing(Onset(at=1.0), 2.0, 2.0)
    current = Current(MEAN, timestep=1e-3).with_flow(STRAIN).with_profile(ramp)
    dt = 1e-3
    p = P_W
    rows = []
    for tick in range(3000):
        rows.append(current.at(p, dt * tick))
        p = p + dt * rows[-1][0]
    velocity, acceleration = (np.array(row) for row in zip(*rows, strict=True))
    plain = Current(MEAN).with_flow(STRAIN).at(P_W, 0.0)[0]
    np.testing.assert_allclose(velocity[0], plain, atol=1e-15)
    assert np.abs(acceleration[1500:2500]).max() > 0.1
    # 7e-4: of the first order
    within("acceleration [m/s^2]", np.diff(velocity, axis=0) / dt - acceleration[:-1], 7e-3)


def test_two_profiles_act_both():
    def once(time: float) -> tuple[float, float]:
        return 1.0 + 0.1 * time, 0.1

    def falling(time: float) -> tuple[float, float]:
        return np.exp(-time), -np.exp(-time)

    both = Current(MEAN, timestep=0.01, profile=once).with_profile(falling)
    for tick in range(3):
        velocity, acceleration = both.step()
        t = 0.01 * tick
        np.testing.assert_allclose(
            velocity, (1.0 + 0.1 * t) * np.exp(-t) * np.array(MEAN), rtol=1e-14
        )
        rate = 0.1 * np.exp(-t) - (1.0 + 0.1 * t) * np.exp(-t)
        np.testing.assert_allclose(acceleration, rate * np.array(MEAN), rtol=1e-14)


def ball() -> mujoco.MjModel:
    """Body of water: neutrally buoyant, of water's mass, without drag and added mass."""
    spec = mujoco.MjSpec.from_string(
        "<mujoco><option timestep='0.002'/><worldbody><body name='hull'><freejoint/><geom "
        "size='.2' mass='50'/></body>"
        "</worldbody></mujoco>"
    )
    attach(spec, {"hull": BodyHydrodynamics(volume=0.05)}, 1000.0)
    return hydrodynamics.compile(spec)


def test_a_body_of_water_goes_round_with_a_turning_flow(within):
    """Released with the water's velocity it stays on its circle, which takes the water's own
    acceleration.
    """
    plant = Plant(
        ball(),
        current=Current([0.0, 0.0, 0.0]).with_flow(TURNING),
        X_WB=pose(exp_so3([0.1, 0.2, 0.3]), P_W),
    )
    axis = AXES[:, 2]
    plant.data.qvel[:3] = TURNING.velocity(P_W, 0.0)
    none = Command(time=0.0, joint_torque=np.zeros(0), thrusters=np.zeros(0), scan=False)
    for _ in range(2500):
        plant.observe()
        np.testing.assert_allclose(
            plant.truth.current_W, TURNING.velocity(plant.truth.p_WB, 0.0), atol=1e-12
        )
        plant.step(none)
    plant.observe()
    expected = exp_so3(0.4 * 5.0 * axis) @ P_W
    assert np.linalg.norm(expected - P_W) > 1.0
    # 9e-4: of the first order in the step
    within("place after 5 s [m]", plant.truth.p_WB - expected, 8e-3)


def test_a_field_is_read_where_the_hull_is_from_the_start_and_after_a_reset():
    model = hydrodynamics.compile(models.load("uuv_puma"))
    X_WB = pose(AXES, P_W)
    plant = Plant(model, current=Current(MEAN).with_flow(STRAIN), X_WB=X_WB)
    expected = np.array(MEAN) + STRAIN.velocity(P_W, 0.0)
    np.testing.assert_allclose(plant.truth.current_W, expected, atol=1e-15)
    for _ in range(3):
        plant.observe()
        plant.step(REST)
    plant.reset(current=Current(MEAN).with_flow(STRAIN))  # at its start again
    np.testing.assert_allclose(plant.truth.current_W, expected, atol=1e-15)
    np.testing.assert_array_equal(plant.data.qpos[:3], P_W)


def test_a_field_that_depends_on_an_object_is_placed_in_the_world():
    @dataclass(frozen=True)
    class AtTheHull:
        mass: float = 0.0

        def placed(self, model):
            return AtTheHull(float(model.body("hull").mass[0]))

        def velocity(self, p_W, time):
            return np.array([0.01 * self.mass, 0.0, 0.0])

    model = hydrodynamics.compile(models.load("uuv_puma"))
    plant = Plant(model, current=Current([0.0, 0.0, 0.0]).with_flow(untyped(AtTheHull())))
    assert plant.truth.current_W[0] == pytest.approx(0.01 * model.body("hull").mass[0])


def test_a_current_of_ones_own_is_called_at_every_step():
    class Counting(Current):
        calls = 0

        def step(self):
            self.calls += 1
            return np.array([0.1 * self.calls, 0.0, 0.0]), np.zeros(3)

    current = Counting([0.0, 0.0, 0.0])
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=current)
    for _ in range(4):
        plant.observe()
        plant.step(REST)
    assert current.calls == 5
    assert plant.truth.current_W[0] == pytest.approx(0.5)


def test_a_method_that_is_set_on_a_current_is_called_too():
    current: Current = Current(MEAN)
    untyped(current).step = lambda: (np.array([0.3, 0.0, 0.0]), np.zeros(3))
    assert "overrides `step` or `at`" in current.beyond_rows()
    assert Current(MEAN).beyond_rows() == ""


@pytest.mark.parametrize("when", ["before", "between"])
def test_water_that_something_else_writes_is_refused(when):
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current(MEAN))
    plant.observe()
    plant.step(REST)
    if when == "between":
        plant.observe()
    plant.model.opt.wind[1] = 0.4
    if when == "before":
        plant.observe()
    with pytest.raises(
        ConfigurationError,
        match=r"opt.wind is \[0.0, 0.4, 0.0\] m/s, "
        r".*`on_water`.*site.flow",
    ):
        plant.step(REST)
    with pytest.raises(ConfigurationError, match=r"opt\.wind is"):
        plant.ready()


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ([0.0, np.nan, 0.0], r"got \[0.0, nan, 0.0\] at \(1.400, -1.700, -2.100\) m, 3.000 s"),
        ([0.0, np.inf, 0.0], "inf"),
        ([0.0, 0.1], "got"),
        (0.1, "got 0.1"),
        (np.zeros((3, 1)), "got"),
        ("fast", "got 'fast'"),
        (None, "got None"),
        ([0.0, [1.0], 0.0], "got"),
    ],
)
def test_a_velocity_that_is_none_is_one_line(value, said):
    with pytest.raises(
        ConfigurationError,
        match=r"flow Given: velocity must be \(3,\) finite numbers \[m/s\], "
        rf".*{said}",
    ):
        Current(MEAN).with_flow(untyped(Given(value))).at(P_W, 3.0)


def test_what_is_no_flow_field_is_refused():
    class OfOne:
        def velocity(self, p_W):
            return p_W

    for flow, words in (
        (Given, "must be an instance, got the class Given"),
        (5, r"needs a method velocity\(p_W, time\), got 5"),
        (OfOne(), r"OfOne.velocity must take \(p_W, time\), this method takes \(p_W\)"),
        (Wave(), r"Wave.velocity must take \(p_W, time\)"),
    ):
        with pytest.raises(ConfigurationError, match=words):
            Current(MEAN).with_flow(untyped(flow))


def test_a_field_cannot_change_the_place_that_it_is_asked_for():
    class Greedy:
        def velocity(self, p_W, time):
            p_W[:] = 0.0
            return np.zeros(3)

    at = deepcopy(P_W)
    Current(MEAN).with_flow(untyped(Greedy())).at(at, 1.0)
    np.testing.assert_array_equal(at, P_W)
