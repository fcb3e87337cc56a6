"""Thrusters against their closed forms, and the trim of the vehicle that they drive."""

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from held_thrusters import HeldThrusters
from uuv import models
from uuv.models.hydrodynamics import LAYOUT, unpack
from uuv.models.naming import HOME_KEY
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.models.water.thruster_curves import command_for, thrust_at
from uuv.models.water.thrusters import Thruster
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, rotation_angle
from uuv.sim.plant.thrusters import Drive, command_thrusters

STEP = 0.002  # [s]
STILL = (np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))  # attitude, velocities, current
X = np.array([1.0, 0.0, 0.0])
MIDDLE = np.zeros(3)


class Unit:
    """One thruster at `p` (3,) [m] of a held hull, with its thrust along `axis` (3,)."""

    def __init__(
        self, thruster: Thruster, timestep: float = STEP, *, p: Array = MIDDLE, axis: Array = X
    ) -> None:
        row = thrusters.pack(thruster)
        wrench = np.concatenate([axis, np.cross(p, axis) + row[thrusters.TORQUE] * axis])
        self._held = HeldThrusters(row[None], wrench[:, None], timestep)
        self.model, self.data = self._held.model, self._held.data

    def step(
        self, command: float, R_WB: Array, v_WB_W: Array, w_WB_B: Array, current_W: Array
    ) -> None:
        """One step of MuJoCo, in which the hull moves so."""
        self._held.step(np.array([command]), R_WB, v_WB_W, w_WB_B, current_W)

    @property
    def speed(self) -> float:
        """Normalised speed of the propeller."""
        return float(self._held.speed[0])

    @property
    def thrust(self) -> float:
        """Thrust [N] in the last step."""
        return float(self._held.thrust[0])


def one(timestep: float = STEP, p: Array = MIDDLE, **changes: Any) -> Unit:
    figures: dict[str, Any] = {"forward": 300.0, "reverse": 220.0, "dead_band": 0.05}
    return Unit(Thruster(**(figures | changes)), timestep, p=p)


def settled(unit: Unit, command: float) -> float:
    unit.step(command, *STILL)
    return unit.thrust


@pytest.mark.check("thruster: step of the command", "first-order lag, in closed form")
def test_step_response_is_that_of_a_first_order_lag(within):
    unit = one(time_constant=0.15)
    lag = 0.15
    speed, thrust = [], []
    for _ in range(500):
        unit.step(0.8, *STILL)
        speed.append(unit.speed)
        thrust.append(unit.thrust)
    time = STEP * np.arange(1, 501)
    exact = 0.8 * (1.0 - np.exp(-time / lag))
    within("speed", np.array(speed) - exact, 1e-14)  # measured 2e-15
    reach = np.maximum((exact - 0.05) / 0.95, 0.0)
    within("thrust [N]", np.array(thrust) - 300.0 * reach**2, 5e-12)  # measured 5e-13
    assert thrust[0] == 0.0
    assert thrust[-1] > 180.0


@pytest.mark.check(
    "thruster: dead band, forward and reverse", "nothing within the band, each its own thrust"
)
def test_dead_band_and_both_directions(within):
    unit = one()
    within("thrust within the band [N]", [settled(unit, u) for u in (0.0, 0.05, -0.05)], 0.0)
    assert settled(unit, 0.051) > 0.0 > settled(unit, -0.051)
    # Quadratic beyond the band: half of the way, a quarter of the thrust.
    command = np.array([1.0, -1.0, 0.525, -0.525, 0.24, -0.24])
    expected = np.array([300.0, -220.0, 75.0, -55.0, 12.0, -8.8])
    # measured 4e-16
    within("relative thrust", [settled(unit, u) for u in command] / expected - 1.0, 4e-15)


@pytest.mark.parametrize(
    ("command", "flag"), [(0.989, False), (1.0, True), (1.7, True), (-1.0, True), (-0.9, False)]
)
def test_saturation_is_told_and_kept(command, flag):
    unit = Unit(Thruster(forward=300.0, reverse=220.0))
    drive = Drive.of(unit.model, unit.data, thrusters.read(unit.model))
    drive.commanded[0] = command
    assert command_thrusters(tuple(drive)) is flag
    assert settled(unit, command) == settled(unit, np.clip(command, -1.0, 1.0))
    assert abs(unit.speed) == min(abs(command), 1.0)


@pytest.mark.check("thruster: inflow", "Fossen 2011, bilinear thruster model")
def test_inflow_takes_thrust_in_proportion_to_speed(rng, within):
    """Fossen's bilinear model: T = T_nn |n| n - T_nu |n| u_a, u_a the water's speed along the
    thrust.
    """
    unit = one(dead_band=0.0, inflow_loss=90.0)
    errors = []
    for _ in range(100):
        R = exp_so3(rng.normal(size=3))
        n = rng.uniform(0.1, 1.0)
        ahead = rng.normal(size=3)
        current = rng.normal(size=3)
        # Astern, an inflow from behind takes as much of the reverse thrust away.
        for sign, most in ((1.0, 300.0), (-1.0, 220.0)):
            unit.step(sign * n, R, R @ ahead + current, np.zeros(3), current)
            still = sign * most * n**2
            lost = 90.0 * n * ahead[0]
            errors.append((unit.thrust - (still - lost)) / (abs(still) + abs(lost)))
    within("relative thrust", errors, 2e-14)  # measured up to 2e-15


def test_inflow_of_a_turning_hull_is_taken_where_the_thruster_stands():
    p = np.array([-0.7, 0.4, 0.1])
    axis = X
    w = np.array([0.1, -0.2, 0.3])
    unit = one(p=p, dead_band=0.0, inflow_loss=90.0)
    unit.step(0.5, np.eye(3), np.zeros(3), w, np.zeros(3))
    assert unit.thrust == pytest.approx(75.0 - 45.0 * axis @ np.cross(w, p), rel=1e-12)


@pytest.mark.check("thruster: slew limit", "a ramp, and the lag's exact response to it")
def test_slew_limit_is_a_ramp_before_the_lag(within):
    """At 2 per second a step to 0.8 is a ramp of 0.4 s; behind a lag T the speed is that ramp's
    exact response.
    """
    unit = one(dead_band=0.0, slew_rate=2.0)
    rate = 2.0
    lag = 0.1
    thrust = [settled(unit, 0.8) for _ in range(400)]
    time = STEP * np.arange(1, 401)
    # measured 3e-13
    within("thrust [N]", np.array(thrust) - 300.0 * np.minimum(rate * time, 0.8) ** 2, 3e-12)
    worst = []
    for step in (0.002, 0.001):
        unit = Unit(Thruster(forward=1.0, reverse=1.0, time_constant=lag, slew_rate=rate), step)
        time = step * np.arange(1, round(0.4 / step) + 1)
        speed = []
        for _ in time:
            unit.step(0.8, *STILL)
            speed.append(unit.speed)
        worst.append(np.max(np.abs(speed - rate * (time - lag * (1.0 - np.exp(-time / lag))))))
    assert worst[0] < 0.005  # half a step of the ramp: 2e-3
    assert worst[0] / worst[1] == pytest.approx(2.0, rel=0.05)


def test_slew_works_both_ways_and_reset_forgets():
    unit = one(dead_band=0.0, slew_rate=5.0)
    for command in (1.0, -1.0):
        for _ in range(50):
            unit.step(command, *STILL)
    assert unit.speed == pytest.approx(0.5 - 0.5, abs=1e-12)  # 50 steps up by 0.01, 50 down
    unit.step(1.0, *STILL)
    mujoco.mj_resetData(unit.model, unit.data)
    unit.step(1.0, *STILL)
    assert unit.speed == pytest.approx(0.01, abs=1e-15)


# -- curves ----------------------------------------------------------------------------------------


def curve(thruster: Thruster) -> Array:
    return thrusters.curves(thrusters.pack(thruster)[None])[0]


def steady(thruster: Thruster, commands: Array) -> Array:
    row = curve(thruster)
    return np.array([thrust_at(row, float(u)) for u in commands])


def inverted(thruster: Thruster, thrusts: Array) -> Array:
    row = curve(thruster)
    return np.array([command_for(row, float(t)) for t in thrusts])


def random_table(rng: np.random.Generator) -> tuple[Array, Array]:
    """Rising points through zero, with a dead band in half of the cases."""
    x = np.sort(rng.uniform(-1.0, 1.0, int(rng.integers(4, 15))))
    x = np.concatenate([[-1.0], x[np.concatenate([[True], np.diff(x) > 1e-3])], [1.0]])
    y = np.cumsum(rng.exponential(10.0, len(x)))
    zero = int(rng.integers(1, len(x) - 1))
    y -= y[zero]
    if zero + 2 < len(x) and rng.random() < 0.5:
        y[zero + 1 :] -= y[zero + 1]
    return x, y


def test_table_is_the_monotone_cubic_and_runs_backwards(rng, within):
    """Against SciPy's PCHIP; and the inverse is exact wherever the thrust can be given."""
    for _ in range(10):
        x, y = random_table(rng)
        unit = Thruster.of_table(x, y)
        u = rng.uniform(-1.0, 1.0, 200)
        within("thrust [N]", steady(unit, u) - PchipInterpolator(x, y)(u), 5e-12)  # measured 6e-14
        thrusts = rng.uniform(y[0], y[-1], 200)
        error = steady(unit, inverted(unit, thrusts)) - thrusts
        within("inverse [N]", error, 1e-10)  # measured 9e-13, more where steeper
        assert np.all(np.diff(steady(unit, np.linspace(-1.0, 1.0, 500))) >= 0.0)
        assert inverted(unit, np.array([2.0 * y[0], 2.0 * y[-1]])).tolist() == [-1.0, 1.0]


def test_polynomial_and_its_inverse(rng, within):
    """Positive coefficients rise; those of any degree are evaluated and inverted to rounding."""
    for _ in range(10):
        ahead, astern = (rng.exponential(20.0, int(rng.integers(1, 10))) for _ in range(2))
        band = float(rng.uniform(0.0, 0.3))
        unit = Thruster.of_polynomial(ahead.tolist(), astern.tolist(), dead_band=band)
        u = rng.uniform(-1.0, 1.0, 200)
        r = np.maximum(np.abs(u) - band, 0.0) / (1.0 - band)
        thrust = np.where(
            u > 0.0, np.polyval([*ahead[::-1], 0.0], r), -np.polyval([*astern[::-1], 0.0], r)
        )
        within("thrust [N]", steady(unit, u) - thrust, 1e-11)  # measured 4e-13
        thrusts = rng.uniform(-unit.reverse, unit.forward, 200)
        # measured 1e-13
        within("inverse [N]", steady(unit, inverted(unit, thrusts)) - thrusts, 1e-11)


def test_a_quadratic_polynomial_is_the_plain_thruster():
    figures: dict[str, Any] = {"dead_band": 0.07, "least_thrust": 3.0}
    plain = Thruster(forward=300.0, reverse=220.0, **figures)
    same = Thruster.of_polynomial([0.0, 300.0], [0.0, 220.0], **figures)
    u, thrust = np.linspace(-1.0, 1.0, 401), np.linspace(-250.0, 350.0, 401)
    assert np.array_equal(steady(plain, u), steady(same, u))
    assert np.allclose(inverted(plain, thrust), inverted(same, thrust), rtol=0.0, atol=1e-15)


def test_least_thrust_leaves_a_gap():
    unit = Thruster(forward=300.0, reverse=220.0, dead_band=0.05, least_thrust=4.0)
    thrust = steady(unit, np.linspace(-1.0, 1.0, 4001))
    assert np.abs(thrust[thrust != 0.0]).min() >= 4.0 * (1.0 - 1e-9)
    nearest = steady(unit, inverted(unit, np.array([1.9, 2.1, 4.0, -1.9, -2.1, -4.0])))
    assert nearest == pytest.approx([0.0, 4.0, 4.0, 0.0, -4.0, -4.0], rel=1e-8)


@pytest.mark.check("T200 at 16 V", "the published table")
def test_t200_is_the_published_table(within):
    """The 16 V sheet, read at its own pulse widths; and its thrusts go with the square of its
    speeds.
    """
    unit = thrusters.t200(least_thrust=0.0)
    pulse = np.array([1100, 1340, 1468, 1472, 1500, 1528, 1532, 1660, 1900])
    published = [-39.91, -10.01, -0.36, 0.0, 0.0, 0.0, 0.40, 12.54, 51.44]
    within(
        "thrust [N]", steady(unit, (pulse - 1500.0) / 400.0) - published, 2e-14
    )  # measured 2e-15
    assert (unit.forward, unit.reverse) == (51.44, 39.91)
    # Thrust follows the square of the published speed to a few percent: an independent column of
    # the same sheet.
    rpm = {1180: -3003, 1260: -2440, 1340: -1807, 1580: 1007, 1660: 1802, 1740: 2446, 1820: 3042}
    for width, speed in rpm.items():
        coefficient = 51.44 / 3533.0**2 if speed > 0 else 39.91 / 3465.0**2
        thrust = steady(unit, np.array([(width - 1500.0) / 400.0]))[0]
        assert thrust == pytest.approx(np.sign(speed) * coefficient * speed**2, rel=0.1)
    assert steady(thrusters.t200(), np.array([0.0, 0.0701, 0.081])).tolist()[:2] == [0.0, 0.0]
    assert steady(thrusters.t200(), np.array([0.081]))[0] > 0.36


# -- torque and transport --------------------------------------------------------------------------


def driven(thruster: Thruster, gear: float = 1.0) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(f"""
    <mujoco><option gravity="0 0 0" timestep="0.001"/>
      <worldbody><body name="hull"><freejoint/><inertial pos="0 0 0" mass="10" diaginertia="2 3 4"/>
        <site name="screw" pos="0.3 0.2 0" euler="10 20 30"/></body></worldbody>
      <actuator><general name="screw" site="screw" gear="{gear} 0 0 0 0 0"/></actuator></mujoco>""")
    thrusters.attach(spec, {"screw": thruster})
    return spec


@pytest.mark.check("thruster: reaction torque of the propeller", "Euler's equations of the hull")
@pytest.mark.parametrize(("handedness", "gear"), [(1, 1.0), (-1, 1.0), (1, -1.0)])
def test_a_right_handed_propeller_turns_its_hull_left_handed(handedness, gear, within):
    """Euler's equations with force T along the axis and torque -+0.02 T about it."""
    thruster = Thruster(forward=50.0, reverse=40.0, torque_per_thrust=0.02, handedness=handedness)
    model = hydrodynamics.compile(driven(thruster, gear))
    data = mujoco.MjData(model)
    data.ctrl[0] = np.sqrt(30.0 / 50.0)
    mujoco.mj_forward(model, data)
    axis = gear * data.site_xmat[0].reshape(3, 3)[:, 0]
    torque = np.cross([0.3, 0.2, 0.0], 30.0 * axis) - handedness * 0.02 * 30.0 * axis
    within("linear [m/s^2]", data.qacc[:3] - 3.0 * axis, 1e-14)
    within("angular [rad/s^2]", data.qacc[3:] - torque / [2.0, 3.0, 4.0], 1e-14)


def test_inflow_is_not_taken_from_the_torque():
    """A hull that rolls about the thrust axis brings no water through the propeller, whatever its
    torque.
    """
    unit = Unit(Thruster(forward=300.0, reverse=220.0, inflow_loss=90.0, torque_per_thrust=0.05))
    unit.step(0.5, np.eye(3), np.zeros(3), np.array([0.7, 0.0, 0.0]), np.zeros(3))
    assert unit.thrust == pytest.approx(75.0, rel=1e-12)


@pytest.mark.parametrize("handedness", [1, -1])
def test_levers_of_the_inflow_are_those_of_a_point(handedness, within):
    """Inflow v . a + w . (p x a) of a point p that moves with the hull, whatever its torque."""
    axis = np.array([0.6, 0.0, 0.8])
    p = np.array([0.3, 0.2, -0.1])
    row = thrusters.pack(
        Thruster(forward=50.0, reverse=40.0, torque_per_thrust=0.05, handedness=handedness)
    )
    wrench = np.concatenate([axis, np.cross(p, axis) - handedness * 0.05 * axis])

    levers = thrusters.inflow_levers(row[None], wrench[:, None])[:, 0]
    within("levers", levers - np.concatenate([axis, np.cross(p, axis)]), 1e-16)


@pytest.mark.parametrize(
    "thruster",
    [
        Thruster(
            forward=300.0,
            reverse=220.0,
            dead_band=0.05,
            time_constant=0.15,
            inflow_loss=90.0,
            slew_rate=4.0,
        ),
        Thruster.of_polynomial(
            [1.0, 20.0, 3.0], [2.0, 15.0], dead_band=0.1, torque_per_thrust=0.02, handedness=-1
        ),
        thrusters.t200(-1),
    ],
)
def test_everything_rides_in_the_model_and_its_xml(thruster):
    for spec in (driven(thruster), mujoco.MjSpec.from_string(driven(thruster).to_xml())):
        model = spec.compile()
        index, rows = thrusters.read(model)
        assert index.tolist() == [0]
        back = thrusters.unpack(rows[0])
        for name in (
            "forward",
            "reverse",
            "time_constant",
            "slew_rate",
            "torque_per_thrust",
            "least_thrust",
        ):
            assert getattr(back, name) == pytest.approx(getattr(thruster, name), rel=1e-5)
        u = np.linspace(-1.0, 1.0, 41)
        assert steady(back, u) == pytest.approx(steady(thruster, u), rel=1e-4, abs=1e-4)
        assert model.actuator_gear[0, 3] == pytest.approx(
            -thruster.handedness * thruster.torque_per_thrust
        )


def test_other_actuators_and_other_peoples_user_data_are_no_thrusters():
    model = models.load("uuv_puma").compile()
    assert len(thrusters.read(model)[0]) == 6
    spec = driven(thrusters.t200())
    motor = spec.add_actuator(name="other", target="screw", trntype=mujoco.mjtTrn.mjTRN_SITE)
    motor.userdata = np.arange(1.0, 41.0)
    thrusters.attach(spec, {"screw": thrusters.t200(-1)})  # replaced, its gear too
    model = spec.compile()
    assert thrusters.read(model)[0].tolist() == [0]
    assert model.actuator_gear[0, 3] == pytest.approx(0.014)
    with pytest.raises(ConfigurationError, match=r"'other'.*holds other data already"):
        thrusters.attach(spec, {"other": thrusters.t200()})


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"forward": 0.0}, "forward"),
        ({"reverse": np.nan}, "reverse"),
        ({"forward": "much"}, "forward"),
        ({"dead_band": 1.0}, "dead_band"),
        ({"time_constant": -1.0}, "time_constant"),
        ({"inflow_loss": np.inf}, "inflow_loss"),
        ({"slew_rate": 0.0}, "slew_rate"),
        ({"slew_rate": np.nan}, "slew"),
        ({"torque_per_thrust": -0.1}, "torque_per_thrust"),
        ({"handedness": 0}, "handedness"),
        ({"least_thrust": 220.0}, "least_thrust"),
        ({"table": ((-1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))}, "dead_band"),
        ({"table": 3.0}, "table"),
        ({"polynomial": ((0.0, 300.0), (0.0, 219.0))}, "must be the ends of the curve"),
    ],
)
def test_thruster_figures_that_cannot_be(change, named):
    with pytest.raises(ConfigurationError, match=named):
        one(**change)


@pytest.mark.parametrize(
    ("command", "thrust", "named"),
    [
        ([-1.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 1.0], "commands must rise"),
        ([-1.0, 0.0, 0.5, 1.0], [-1.0, 0.0, 2.0, 1.0], "thrusts must rise"),
        ([-1.0, -0.5, 0.5, 1.0], [-2.0, -1.0, 1.0, 2.0], "through zero"),
        ([0.0, 0.5, 1.0], [0.0, 1.0, 2.0], "from below zero"),
        ([-1.0, 0.0, 1.0], [-1.0, 0.0, np.nan], "finite"),
        ([-1.0, 0.0], [-1.0, 0.0, 1.0], "pairs"),
        ([], [], "full"),
    ],
)
def test_tables_that_cannot_be(command, thrust, named):
    with pytest.raises(ConfigurationError, match=named):
        Thruster.of_table(command, thrust)


@pytest.mark.parametrize(
    "coefficients",
    [[], [0.0, -3.0], [5.0, -4.0], [1.0, np.inf], [8.9, 0, 176, 0, -404.1, 0, 389.9, 0, -140.3]],
)
def test_polynomials_that_do_not_rise(coefficients):
    with pytest.raises(ConfigurationError, match="polynomial"):
        Thruster.of_polynomial(coefficients)


def test_a_gear_that_is_no_axis():
    with pytest.raises(ConfigurationError, match=r"gear of length 1, got \[2"):
        driven(thrusters.t200(), gear=2.0)


def test_a_row_spoiled_in_the_file():
    spec = driven(thrusters.t200())
    row = np.array(spec.actuators[0].userdata)
    row[thrusters.TIME_CONSTANT] = -1.0
    spec.actuators[0].userdata = row
    with pytest.raises(ConfigurationError, match=r"actuator 'screw'.*time_constant"):
        thrusters.read(spec.compile())


def test_a_row_that_says_another_dead_band_than_its_curve():
    """The plant drives by the curve: the other number would be without effect."""
    spec = driven(Thruster(forward=40.0, reverse=30.0, dead_band=0.05))
    row = np.array(spec.actuators[0].userdata)
    row[thrusters.DEAD_BAND] = 0.1
    spec.actuators[0].userdata = row
    with pytest.raises(ConfigurationError, match=r"actuator 'screw'.*dead band"):
        thrusters.read(spec.compile())


def test_a_changed_row_has_its_numbers_in_the_curve_too(within):
    spec = driven(Thruster(forward=40.0, reverse=30.0, dead_band=0.05))
    row = thrusters.changed(np.array(spec.actuators[0].userdata), dead_band=0.1, forward=50.0)
    spec.actuators[0].userdata = row
    _, rows = thrusters.read(spec.compile())
    unpacked = thrusters.unpack(rows[0])
    assert (unpacked.dead_band, unpacked.forward, unpacked.reverse) == (0.1, 50.0, 30.0)
    curve = thrusters.curves(rows)[0]
    within("no thrust in the band [N]", thrust_at(curve, 0.0999), 1e-12)


def test_table_for_an_actuator_that_is_not_there():
    with pytest.raises(ConfigurationError, match=r"thruster 'bow'.*thruster_sway"):
        thrusters.attach(models.load("uuv_puma"), {"bow": Thruster(forward=1.0, reverse=1.0)})


# -- trim ------------------------------------------------------------------------------------------


def at_home(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The vehicle in its home pose, its joints held there as if by brakes."""
    spec = models.load(name)
    model = spec.copy().compile()
    home = model.key(HOME_KEY).qpos
    for i in range(model.njnt):
        joint = model.joint(i)
        address = int(model.jnt_qposadr[i])
        if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE:
            stiff = 3e4 if model.jnt_stiffness[i] == 0.0 else model.jnt_stiffness[i]
            spec.joint(joint.name).stiffness = (
                [stiff, 0, 0] if np.ndim(spec.joint(joint.name).stiffness) else stiff
            )
            spec.joint(joint.name).springref = home[address]
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME_KEY).id)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", ["uuv_puma"])
def test_weight_is_buoyancy_and_the_arm_of_righting_is_upright(name, within):
    model, data = at_home(name)
    density = model.body_user[0, LAYOUT.density]
    gravity = -model.opt.gravity[2]
    displaced = 0.0
    moment = np.zeros(3)
    for b in range(1, model.nbody):
        body = unpack(model.body_user[b])
        displaced += density * body.volume
        moment += (
            density
            * body.volume
            * (data.xpos[b] + data.xmat[b].reshape(3, 3) @ body.center_of_buoyancy)
        )
    weighed = float(np.sum(model.body_mass))
    center = np.sum(model.body_mass[:, None] * data.xipos, axis=0) / weighed
    lever = moment / displaced - center
    within("net weight [N]", gravity * (displaced - weighed), 1e-10)  # measured 5e-13
    within("righting arm [m]", lever[:2], 1e-14)  # measured 3e-17
    assert 0.03 < lever[2] < 0.15  # stable: the centre of buoyancy above the centre of mass


@pytest.mark.parametrize("name", ["uuv_puma"])
def test_trimmed_vehicle_stays_where_it_is(name, within):
    model, data = at_home(name)
    hull = Vehicle.of(model).hull
    p = data.xpos[hull].copy()
    R = data.xmat[hull].reshape(3, 3).copy()
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    mujoco.mj_forward(model, data)
    within("drift in 60 s [m]", data.xpos[hull] - p, 5e-5)  # measured 4e-6
    # measured 7e-6, 0.0004 deg
    within("turn in 60 s [rad]", rotation_angle(R, data.xmat[hull].reshape(3, 3)), 1e-4)


def test_an_untrimmed_vehicle_would_not_stay():
    """The same hold, a kilogram of lead on the bow: the figures above can fail."""
    model, data = at_home("uuv_puma")
    hull = Vehicle.of(model).hull
    data.xfrc_applied[hull, :3] = [0.0, 0.0, -9.81]
    data.xfrc_applied[hull, 4] = 9.81 * 0.7
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    assert data.xpos[hull][2] < -0.5
    assert rotation_angle(np.eye(3), data.xmat[hull].reshape(3, 3)) > np.radians(0.5)
