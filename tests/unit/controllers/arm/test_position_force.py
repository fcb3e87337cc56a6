"""The displacement from the force error: closed form on springs, what it learns of them, limits,
windup, release.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.position_force import ForceDisplacement, ForceDisplacementState
from uuv.controllers.tuning import ArmTuning, ForceLoopTuning
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import pose

SERVO = 4e-5  # [m]/[N]
DT = 0.002  # [s]


def pressed(loop, state, spring, set_force, dt=DT, servo=SERVO):
    """Felt force over the course of `set_force`, with the tool borne by its servo against a spring
    [N/m].

    The drives bear the set force at once, so the tool gives way by servo * (felt - set_force) from
    where it is displaced.
    """
    felt = []
    k = state.k
    for force in set_force:
        felt.append((k + servo * force) / (1.0 / spring + servo))
        k = loop.step(state, force, felt[-1], servo, dt)
    return np.array(felt)


def test_force_on_a_spring_settles_as_the_equations_say(within):
    """Integral action alone on servo and surface in series: the error decays at 24 rad/s (servo +
    known) / (both).
    """
    loop = ForceDisplacement(speed=10.0, prior=1e9)
    spring = 3e4
    dt = 1e-5
    time = dt * np.arange(20000)
    felt = pressed(loop, ForceDisplacementState(), spring, np.full(len(time), 10.0), dt)
    rate = 24.0 * SERVO / (SERVO + 1.0 / spring)
    exact = 10.0 - (10.0 - felt[0]) * np.exp(-rate * time)
    within("force [N]", felt - exact, 5e-3)  # measured 6e-4, of the first order in dt


@pytest.mark.parametrize("spring", [5e3, 1e4, 3e4, 1e5, 1e6])
def test_surface_is_learnt_as_the_force_grows(spring):
    """The slope of k over the force is the surface's compliance, on rubber and on steel; on steel
    it hardly counts.
    """
    loop, state = ForceDisplacement(), ForceDisplacementState()
    ramp = np.concatenate([np.linspace(6.0, 60.0, 450), np.full(500, 60.0)])
    pressed(loop, state, spring, ramp)
    assert state.compliance == pytest.approx(1.0 / spring, abs=0.15 / spring + 0.05 * SERVO)


@pytest.mark.parametrize("spring", [1e4, 3e4, 1e5, 1e6])
def test_a_step_overshoots_little_on_any_surface_with_one_tuning(spring):
    loop, state = ForceDisplacement(), ForceDisplacementState()
    pressed(loop, state, spring, np.concatenate([np.linspace(6.0, 60.0, 450), np.full(500, 60.0)]))
    felt = pressed(
        loop, state, spring, np.concatenate([np.linspace(60.0, 90.0, 250), np.full(500, 90.0)])
    )
    assert felt.max() < 90.0 + 0.05 * 30.0
    assert felt[-1] == pytest.approx(90.0, abs=0.1)


def test_a_change_of_the_set_force_is_displaced_at_once_by_what_is_known_of_the_surface():
    """Beside what the error will still do, which in one step is little."""
    loop = ForceDisplacement()
    k = []
    for change in (0.0, 0.5):
        state = ForceDisplacementState()
        felt = pressed(
            loop, state, 3e4, np.concatenate([np.linspace(6.0, 60.0, 450), np.full(500, 60.0)])
        )
        k.append(loop.step(state, 60.0 + change, felt[-1], SERVO, DT))
    assert state.compliance > 2e-5
    assert k[1] - k[0] == pytest.approx(0.5 * state.compliance, rel=0.02)


def test_a_drifting_surface_at_a_steady_force_teaches_nothing():
    """What k does at a steady force is the path's shape or the hull's drift; the compliance stays
    as it was.
    """
    loop, state = ForceDisplacement(), ForceDisplacementState()
    pressed(loop, state, 3e4, np.concatenate([np.linspace(6.0, 60.0, 450), np.full(500, 60.0)]))
    known, k = state.compliance, state.k
    for i in range(5000):
        surface = 1e-3 * np.sin(1e-3 * i)
        felt = (k - surface + SERVO * 60.0) / (1.0 / 3e4 + SERVO)
        k = loop.step(state, 60.0, felt, SERVO, DT)
    assert state.compliance == known


def test_speed_and_size_of_the_displacement_are_limited():
    loop = ForceDisplacement()
    state = ForceDisplacementState()
    rng = np.random.default_rng(1)
    last = furthest = 0.0
    for _ in range(5000):
        k = loop.step(state, 60.0, -20.0 * rng.standard_normal(), SERVO, DT)
        assert abs(k - last) <= loop.speed * DT * (1.0 + 1e-12)
        assert abs(k) <= loop.limit
        last = k
        furthest = max(furthest, k)
    assert furthest == loop.limit


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_windup(sign):
    """However long the output was at its limit, it leaves it with the first error of the other
    sign.
    """
    loop = ForceDisplacement()
    turned = []
    for seconds in (5, 50):
        state = ForceDisplacementState()
        for _ in range(round(seconds / DT)):
            loop.step(state, 0.0, -sign * 80.0, SERVO, DT)
        assert state.k == sign * loop.limit
        turned.append([loop.step(state, 0.0, sign * 5.0, SERVO, DT) for _ in range(100)])
    assert turned[0] == pytest.approx(turned[1], abs=1e-15)
    assert sign * turned[0][0] < loop.limit
    # 5 N for 0.2 s through the integral alone.
    assert sign * (sign * loop.limit - turned[0][-1]) >= 0.99 * loop.bandwidth * SERVO * 5.0 * 0.2


def test_release_goes_back_at_the_limited_speed_and_takes_up_again_without_a_bump():
    loop, state = ForceDisplacement(), ForceDisplacementState()
    for _ in range(1000):
        loop.step(state, 60.0, 0.0, SERVO, DT)
    start = state.k
    assert start > 0.02
    depths = [loop.release(state, DT) for _ in range(100)]
    assert np.diff([start, *depths]) == pytest.approx(-loop.speed * DT, rel=1e-9)
    assert loop.step(state, 20.0, 20.0, SERVO, DT) == pytest.approx(depths[-1], abs=1e-15)
    for _ in range(2000):
        loop.release(state, DT)
    assert state.k == 0.0
    assert loop.step(state, 0.0, 0.0, SERVO, DT) == 0.0


def test_a_tool_that_is_held_off_the_expected_surface_stays_off_on_its_way_back():
    loop = ForceDisplacement()
    # the surface nearer than expected, and farther
    for set_force, felt in ((0.0, 60.0), (60.0, 0.0)):
        state = ForceDisplacementState()
        for _ in range(500):
            loop.step(state, set_force, felt, SERVO, DT)
        start = state.k
        for _ in range(2000):
            loop.release(state, DT, inwards=False)
        assert abs(start) > 0.01
        assert state.k == min(start, 0.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("bandwidth", 0.0),
        ("proportional_time", float("nan")),
        ("derivative_time", -1e-9),
        ("limit", 0.0),
        ("speed", -0.1),
        ("softest", 0.0),
        ("prior", float("nan")),
    ],
)
def test_gains_that_cannot_be(name, value):
    with pytest.raises(ConfigurationError, match=name):
        ForceDisplacement(**{name: value})


def test_the_servo_hardens_slowly_once_the_force_loop_opens(within):
    """As soft as it is under force control at first, and then linearly as stiff as ever, in
    `hardening_time`.
    """
    model = models.load("uuv_puma").compile()
    data, vehicle = mujoco.MjData(model), Vehicle.of(model)
    data.qpos[vehicle.qpos] = vehicle.q_ready
    mujoco.mj_kinematics(model, data)
    still = np.zeros(3)
    n = len(vehicle.joints)
    X_WG = pose(np.array(data.site_xmat[vehicle.tip]).reshape(3, 3), data.site_xpos[vehicle.tip])
    estimate = StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=still,
        w_WB_B=still,
        a_WB_B=still,
        q=vehicle.q_ready,
        qd=np.zeros(n),
        tau=np.zeros(n),
    )
    press = Reference.holding(
        0.0,
        np.eye(4),
        vehicle.q_ready,
        state=WorkState.WORK,
        X_WG=X_WG,
        set_force=60.0,
        force_control=True,
    )
    tuning = ArmTuning()
    controller = WorkController(model, tuning=tuning)
    state = controller.init(estimate)
    softness = []
    for setpoint in (
        press,
        *[replace(press, set_force=0.0, force_control=False)]
        * round(1.5 * tuning.hardening_time / DT),
    ):
        state, _ = controller.step(state, estimate, setpoint)
        softness.append(float(state.softness[0]))
    share = DT * np.arange(len(softness)) / tuning.hardening_time
    within("softness", softness - tuning.normal_softness * np.clip(1.0 - share, 0.0, 1.0), 1e-12)


@pytest.mark.parametrize("name", ["bandwidth", "limit", "response", "derivative_time", "prior"])
@pytest.mark.parametrize("value", [np.inf, np.nan, -1.0])
def test_numbers_that_cannot_be_are_named(name, value):
    with pytest.raises(ConfigurationError, match=f"displacement {name}: must be"):
        ForceLoopTuning(**{name: value})
