"""The lead against the plant's own thrusters: closed form of what comes, what it costs, and what a
wrong lag leaves.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from at_rest import at_rest
from held_thrusters import HeldThrusters
from uuv import models
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.hull_control import HullControl
from uuv.controllers.hull.thruster_lead import ThrusterLead, static_commands
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, LEAST, SLEW_RATE, TIME_CONSTANT, curves
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Reference, WorkState
from uuv.sim.interfaces.spatial import Array, pose

DT, STEP = 0.02, 0.002  # [s] of the hover, of the physics
STILL = np.zeros(6)


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return Vehicle.of(models.load("uuv_puma").compile())


def changed(vehicle: Vehicle, column: int, value: float) -> Vehicle:
    table = vehicle.thruster_table.copy()
    table[:, column] = value
    return replace(vehicle, thruster_table=table)


def follow(
    vehicle: Vehicle, lead: ThrusterLead, wanted: Array, nu_r_B: Array = STILL
) -> tuple[Array, Array, Array, Array]:
    """Speeds (k, m) at the end of each step, commands (k, m), mean wrenches given (k, 6) and
    predicted (k, 6).
    """
    plant = HeldThrusters(vehicle.thruster_table, vehicle.thruster_wrench, STEP)
    state, speeds, commands, thrusts, known = lead.init(), [], [], [], []
    for row in wanted:
        command = lead.step(state, row, nu_r_B, DT)
        thrust = np.zeros(len(row))
        for _ in range(round(DT / STEP)):
            plant.step(command, np.eye(3), nu_r_B[:3], nu_r_B[3:], np.zeros(3))
            thrust += plant.thrust * STEP / DT
        speeds.append(plant.speed.copy())
        commands.append(command)
        thrusts.append(vehicle.thruster_wrench @ thrust)
        known.append(state.given_B.copy())
    return np.array(speeds), np.array(commands), np.array(thrusts), np.array(known)


def steps(level: float, count: int = 40) -> Array:
    return np.tile(level * np.array([1.0, -0.5, 0.8, 0.3, -1.0, 0.6]), (count, 1))


def test_the_speed_comes_with_the_lag_that_is_asked_for(vehicle, within):
    """Within the range of the command: n = c (1 - exp(-t / T_r)) at every step of the hover,
    exactly.
    """
    speeds, commands, _, _ = follow(vehicle, ThrusterLead(vehicle, response=0.05), steps(0.3))
    assert np.abs(commands).max() < 1.0
    t = DT * np.arange(1, len(speeds) + 1)
    # measured 2e-16
    within("speed", speeds - steps(0.3) * (1.0 - np.exp(-t / 0.05))[:, None], 1e-14)


@pytest.mark.parametrize("response", [0.15, 0.2])
def test_a_slow_response_leaves_the_command_alone(vehicle, response):
    request = steps(0.5)
    assert np.array_equal(
        follow(vehicle, ThrusterLead(vehicle, response=response), request)[1], request
    )


@pytest.mark.parametrize("level", [0.3, 0.9])
def test_what_is_given_is_known(vehicle, level, within):
    """Mean wrench over each step, with the command at its limit or not, in still water and in a
    stream.
    """
    for nu_r_B in (STILL, np.array([0.3, -0.2, 0.1, 0.05, 0.0, 0.1])):
        _, commands, thrusts, known = follow(vehicle, ThrusterLead(vehicle), steps(level), nu_r_B)
        assert (np.abs(commands).max() == 1.0) == (level == 0.9)
        scale = np.abs(thrusts).max(axis=0)
        # measured 8e-3: four points against ten physics steps
        within("mean wrench", (known - thrusts)[1:] / scale, 0.05)


def test_slow_drives_are_reckoned_with(vehicle, within):
    slewing = changed(vehicle, SLEW_RATE, 2.0)
    _, _, given, told = follow(slewing, ThrusterLead(slewing), steps(0.6, 60))
    within("settled wrench", (told - given)[-1] / np.abs(given).max(axis=0), 1e-3)


def test_a_step_of_force_comes_sooner_also_with_a_wrong_lag(vehicle):
    """90 N down within one step: force missing, integrated over the first 0.6 s [N s], by the lag
    that is true.
    """
    allocation = Allocation(vehicle)
    command = allocation.command(allocation.thrust(np.array([0.0, 0.0, -90.0, 0.0, 0.0, 0.0])))

    def missing(true_lag: float, lead: ThrusterLead) -> float:
        thrusts = follow(
            changed(vehicle, TIME_CONSTANT, true_lag), lead, np.tile(command, (30, 1))
        )[2]
        return float(np.abs(thrusts[:, 2] + 90.0).sum() * DT)

    # the lead believes 0.15: too long, right, too short by half
    for true_lag in (0.10, 0.15, 0.225):
        none, some = (
            missing(true_lag, ThrusterLead(vehicle, response=1.0)),
            missing(true_lag, ThrusterLead(vehicle)),
        )
        assert some < 0.65 * none, (true_lag, some, none)


def test_the_steady_thrust_is_as_wanted_whatever_the_lag(vehicle, within):
    for error in (-0.5, 0.5):
        speeds = follow(vehicle, ThrusterLead(vehicle, lag_error=error), steps(0.7, 200))[0]
        within("speed", speeds[-1] - steps(0.7)[0], 1e-8)  # measured 1e-12


def test_noise_of_the_command_grows_by_the_ratio_of_the_lags(vehicle, within):
    """White noise on what is wanted: its gain is that of the discrete filter, worked out by
    hand.
    """
    request = 0.3 + 0.01 * np.random.default_rng(1).standard_normal((20_000, 6))
    lead = ThrusterLead(vehicle, response=0.05)
    state = lead.init()
    commands = np.array([lead.step(state, row, STILL, DT) for row in request])
    keep, g = np.exp(-DT / 0.05), np.expm1(-DT / 0.05) / np.expm1(-DT / 0.15)
    # n' = keep n + (1 - keep) c, u = n + g (c - n): u is white g c beside (1 - g) n, and n is an
    # AR(1) of the past c.
    gain = np.sqrt(g**2 + (1.0 - g) ** 2 * (1.0 - keep) ** 2 / (1.0 - keep**2))
    # 120 000 numbers: 3e-3
    within("growth of noise", commands[100:].std() / 0.01 / gain - 1.0, 0.03)


def test_the_static_command_gives_the_thrust_wanted_in_any_inflow(vehicle, rng, within):
    """Against the plant's own thrusters, run to their end; where full speed gives less, full
    speed.
    """
    lead, low = ThrusterLead(vehicle), vehicle.thruster_table[:, LEAST]
    reached = full = 0
    for _ in range(200):
        nu_r_B = rng.normal(size=6) * [0.5, 0.5, 0.5, 0.2, 0.2, 0.2]
        request = rng.uniform(-1.0, 1.0, 6) * rng.choice([20.0, 250.0])
        request[np.abs(request) < low] = 0.0
        command = static_commands(lead.propellers, request, nu_r_B)
        plant = HeldThrusters(vehicle.thruster_table, vehicle.thruster_wrench, DT)
        for _ in range(round(40.0 * vehicle.thruster_table[:, TIME_CONSTANT].max() / DT)):
            plant.step(command, np.eye(3), nu_r_B[:3], nu_r_B[3:], np.zeros(3))
        assert np.all(np.sign(command) == np.sign(request))
        inside = np.abs(command) < 1.0
        # The flow may drive a slow propeller to more than is wanted: then the least thrust is the
        # nearest.
        helped = (
            inside
            & (np.abs(plant.thrust) > np.abs(request))
            & (np.abs(np.abs(thrust_of(vehicle, command)) - low) < 1e-6)
        )
        exact = inside & ~helped
        within("thrust [N]", (plant.thrust - request)[exact], 1e-7)
        assert np.all(np.abs(plant.thrust[~inside]) <= np.abs(request[~inside]) + 1e-7)
        reached, full = reached + int(exact.sum()), full + int((~inside).sum())
    assert reached > 1000
    assert full > 20


def thrust_of(vehicle: Vehicle, command: Array, v_B: Array = STILL[:3]) -> Array:
    """Steady thrust of a hull that moves at `v_B` through the water."""
    table = vehicle.thruster_table
    inflow = vehicle.thruster_wrench[:3].T @ v_B
    rows = zip(curves(table), table[:, INFLOW_LOSS], inflow, command, strict=True)
    return np.array([thrust_in_flow(curve, loss, speed, u) for curve, loss, speed, u in rows])


def test_thrusters_without_a_lag_get_what_is_wanted(vehicle):
    quick = changed(vehicle, TIME_CONSTANT, 0.0)
    speeds, commands, _, _ = follow(quick, ThrusterLead(quick), steps(0.4))
    assert np.array_equal(commands, steps(0.4))
    assert np.array_equal(speeds, steps(0.4))


@pytest.mark.parametrize(
    ("figures", "named"),
    [
        ({"response": 0.0}, "response"),
        ({"response": np.inf}, "response"),
        ({"response": np.nan}, "response"),
        ({"lag_error": -1.0}, "lag_error"),
        ({"lag_error": np.nan}, "lag_error"),
    ],
)
def test_figures_that_cannot_be(vehicle, figures, named):
    with pytest.raises(ConfigurationError, match=named):
        ThrusterLead(vehicle, **figures)


def test_commands_that_cannot_be(vehicle):
    lead = ThrusterLead(vehicle)
    with pytest.raises(ConfigurationError, match="thruster commands wanted"):
        lead.step(lead.init(), np.zeros(5), STILL, DT)
    with pytest.raises(ConfigurationError, match="motion through the water"):
        lead.step(lead.init(), np.zeros(6), np.full(6, np.nan), DT)


def hold(**changed: Any) -> Reference:
    """Keep the hull at the origin, the arm at its zero."""
    three = np.zeros(3)
    still = dict.fromkeys(("v_WB_W", "v_WG_W", "w_WG_W"), three)
    off = dict.fromkeys(("force_control", "tare", "scan"), False)
    joints = {name: np.zeros(6) for name in ("q", "qd")}
    return Reference(
        time=0.0,
        state=WorkState.DONE,
        X_WB=np.eye(4),
        X_WG=None,
        set_force=0.0,
        path_s=0.0,
        **still,
        **off,
        **joints,
        **changed,
    )


def test_what_is_asked_for_in_a_current_is_what_comes(vehicle, within):
    """A hull at rest in a current of 0.45 m/s that it knows of: commands for still water miss the
    wrench by 20 N.
    """
    control = HullControl(models.load("uuv_puma").compile())
    state, rest, reference = control.init(), at_rest(), hold()
    command = np.zeros(len(vehicle.thruster_names))
    for step in range(100):
        state.station.observer.current_W[:] = [0.4, -0.2, 0.0]
        command = control.step(state, replace(rest, time=0.02 * step), reference, np.zeros(6))
    thrusts = thrust_of(vehicle, command, control.station.through_water(state.station, rest)[:3])
    within("wrench [N, N m]", vehicle.thruster_wrench @ thrusts - state.wanted_B, 0.5)
    assert (
        np.abs(vehicle.thruster_wrench @ thrust_of(vehicle, command) - state.wanted_B).max() > 20.0
    )


def test_a_stuck_thruster_is_borne_by_the_others(within):
    """A heave thruster that gives 15 N whatever is commanded: with what the others are told the
    hull feels nothing.
    """
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    control, stuck, thrust = HullControl(model), vehicle.thruster_names.index("heave_left"), 15.0
    rest, reference = at_rest(), hold(lost_thrusters=(stuck,), lost_thrust=(thrust,))
    state, B = control.init(), vehicle.thruster_wrench
    command = np.zeros(len(vehicle.thruster_names))
    for step in range(200):
        command = control.step(state, replace(rest, time=0.02 * step), reference, np.zeros(6))
    given = thrust_of(vehicle, command, control.station.through_water(state.station, rest)[:3])
    assert given[stuck] == 0.0
    left = (B @ given + thrust * B[:, stuck])[[2, 3, 4]]  # what comes first after a loss
    within(
        "heave, roll, pitch [N, N m]", float(np.abs(left - state.wanted_B[[2, 3, 4]]).max()), 8.0
    )
    alone = B @ given - state.wanted_B
    # without the stuck one they would be out of balance
    assert np.abs(alone[[2, 3, 4]]).max() > 10.0


def test_depth_is_kept_when_a_dead_heave_thruster_meets_a_stuck_surge_thruster():
    """Levels first would let the hull sink: without heave_left a level hull has no heave of its own
    to give.
    """
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    names = vehicle.thruster_names
    lost = (names.index("heave_left"), names.index("surge_right"))
    rest, reference = at_rest(), hold(lost_thrusters=lost, lost_thrust=(0.0, -190.0))
    up = replace(
        reference, X_WB=reference.X_WB + 0.3 * np.outer([0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0])
    )
    control = HullControl(model)
    state, command = control.init(), np.zeros(len(names))
    # soon: the observer takes a hull that does not move for one that is held
    for step in range(10):
        command = control.step(state, replace(rest, time=0.02 * step), up, np.zeros(6))
    thrusts = thrust_of(vehicle, command, control.station.through_water(state.station, rest)[:3])
    request = float(state.wanted_B[2])
    assert request > 50.0
    assert (vehicle.thruster_wrench @ thrusts)[2] > 0.5 * request


class Halved(Allocation):
    """An allocation of one's own."""

    def thrust(self, wrench_B: Array) -> Array:
        """Half of the usual thrusts."""
        return 0.5 * super().thrust(wrench_B)


class Eager(ThrusterLead):
    """A lead of one's own."""

    def step(self, state: Any, wanted: Array, nu_r_B: Array, dt: float) -> Array:
        """No lead at all."""
        return wanted


@pytest.mark.parametrize("part", ["allocation", "lead"])
def test_a_part_that_the_compiled_loop_would_not_call_is_refused(vehicle, part):
    model = models.load("uuv_puma").compile()
    own: Any = Halved(vehicle) if part == "allocation" else Eager(vehicle)
    with pytest.raises(ConfigurationError, match=f"control of the hull: {type(own).__name__} over"):
        HullControl(model, **{part: own})


def test_the_allocation_follows_the_thrusters_that_are_lost():
    """Lost, stuck and sound again: each step is that of a control that knew no other reference."""
    model = models.load("uuv_puma").compile()
    control, X_WB = HullControl(model), pose(p=[0.3, -0.2, 0.1])
    losses = [((), ()), ((1,), (0.0,)), ((1,), (60.0,)), ((0, 1), (0.0, -90.0)), ((), ())]
    for before in losses:
        for lost, thrust in losses:
            state, fresh = control.init(), control.init()
            control.refer(state, hold(lost_thrusters=before[0], lost_thrust=before[1]))
            reference = replace(hold(lost_thrusters=lost, lost_thrust=thrust), X_WB=X_WB)
            command = control.step(state, at_rest(), reference, np.zeros(6))
            assert np.array_equal(command, control.step(fresh, at_rest(), reference, np.zeros(6)))
            assert np.array_equal(command[list(lost)], np.zeros(len(lost)))
