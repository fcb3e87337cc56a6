"""Blind departure: the thrusts balance what they did without the contact, and push off the surface, then up."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.safety.blind_departure import BlindDeparture, DepartureStage, HullBalance, ascent_direction
from controllers.safety.safety_wrapper import SafetyWrapper
from controllers.tuning import SAFETY
from models.vehicle import Vehicle
from models.water.thruster_curves import thrust_at
from models.water.thrusters import FORWARD, REVERSE, curves
from sim.interfaces.messages import Command, ContactEstimate, Reference, StateEstimate, WorkState
from sim.interfaces.spatial import Array, exp_so3, pose

MODEL = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(MODEL)
ARM = ArmDynamics(MODEL)
PUSH = SAFETY.leave_acceleration * float(MODEL.body_subtreemass[VEHICLE.hull])
N, M = len(VEHICLE.joints), len(VEHICLE.thruster_names)
DT = 0.01


def at_work(rng: np.random.Generator, force: float) -> tuple[StateEstimate, Command, Reference]:
    """Hull and tool in random directions, pressed with `force` [N] at random thrusts within a half of full ones."""
    X_WB = pose(exp_so3(0.3 * rng.standard_normal(3)), rng.standard_normal(3))
    X_WG = pose(exp_so3(rng.standard_normal(3)), rng.standard_normal(3))
    sound = StateEstimate(
        time=0.0,
        X_WB=X_WB,
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=np.array(VEHICLE.q_ready) + 0.1 * rng.standard_normal(N),
        qd=np.zeros(N),
        tau=np.zeros(N),
    )
    force_W = X_WG[:3, :3] @ [*(0.1 * force * rng.standard_normal(2)), -force]
    command = Command(
        time=0.0,
        joint_torque=np.zeros(N),
        thrusters=rng.uniform(-0.5, 0.5, M),
        scan=False,
        contact=ContactEstimate(force_W=force_W, normal=force),
    )
    reference = Reference(
        time=0.0,
        state=WorkState.WORK,
        X_WB=X_WB,
        v_WB_W=np.zeros(3),
        X_WG=X_WG,
        v_WG_W=np.zeros(3),
        w_WG_W=np.zeros(3),
        q=np.zeros(N),
        qd=np.zeros(N),
        force=force,
        force_control=True,
        tare=False,
        scan=False,
        path_s=0.0,
    )
    return sound, command, reference


def stages(sound: StateEstimate, reference: Reference, *commands: Command) -> tuple[DepartureStage, ...]:
    """Stages after `commands`."""
    balance = HullBalance()
    for command in commands:
        balance.follow(command, command.time)
    return BlindDeparture(MODEL, VEHICLE, ARM).stages(balance, sound, reference)


def thrusts(commands: Array) -> Array:
    """Steady thrusts (m,) [N] in still water."""
    table = VEHICLE.thruster_table
    return np.array([thrust_at(curve, one) for curve, one in zip(curves(table), commands, strict=True)])


def pushed(sound: StateEstimate, command: Command, contact_W: Array, thrusters: Array) -> Array:
    """Wrench (6,), hull axes, that `thrusters` give beyond those of `command`, with the contact gone."""
    at_tip = np.zeros(6)
    at_tip[:3] = sound.X_WB[:3, :3].T @ contact_W
    at_tip[3:] = np.cross(ARM.tip(sound.q)[0][:3, 3], at_tip[:3])
    return VEHICLE.thruster_wrench @ (thrusts(thrusters) - thrusts(command.thrusters)) - at_tip


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), force=st.floats(0.0, 40.0))
def test_the_hull_is_held_without_the_contact_and_pushed_off_the_surface_then_up(seed: int, force: float):
    sound, command, reference = at_work(np.random.default_rng(seed), force)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    up_W = ascent_direction(off_W) / np.linalg.norm(ascent_direction(off_W))
    leave, rise = stages(sound, reference, command)
    assert (leave.until, rise.until) == (SAFETY.leave_time, SAFETY.leave_time + SAFETY.rise_time)
    table = VEHICLE.thruster_table
    for stage, along_W in ((leave, off_W), (rise, up_W)):
        given_thrusts = thrusts(stage.thrusters)
        assert np.all(given_thrusts <= table[:, FORWARD] + 1e-6)
        assert np.all(given_thrusts >= -table[:, REVERSE] - 1e-6)
        wrench = pushed(sound, command, command.contact.force_W, stage.thrusters)
        along_B = sound.X_WB[:3, :3].T @ along_W
        push = float(wrench[:3] @ along_B)
        limited = np.any((given_thrusts > table[:, FORWARD] - 1e-6) | (given_thrusts < -table[:, REVERSE] + 1e-6))
        assert push == pytest.approx(PUSH, abs=1e-9) or (limited and -1e-9 <= push < PUSH)
        # No other force, and no moment: the hull's balance stays what it was. Measured: 4e-13.
        assert np.allclose(wrench, np.append(push * along_B, np.zeros(3)), rtol=0.0, atol=1e-9)


def test_an_unknown_contact_counts_as_the_set_force():
    sound, command, reference = at_work(np.random.default_rng(1), 40.0)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    unknown = replace(command, contact=ContactEstimate())
    leave, _ = stages(sound, reference, unknown)
    wrench = pushed(sound, unknown, 40.0 * off_W, leave.thrusters)
    assert wrench[:3] @ (sound.X_WB[:3, :3].T @ off_W) == pytest.approx(PUSH, abs=1e-9)
    assert np.abs(wrench[3:]).max() < 1e-9


@pytest.mark.parametrize(("name", "pushes"), [("heave_left", False), ("sway", True)])
def test_a_full_thruster_takes_the_push_with_it_if_it_would_have_a_part_in_it(name: str, pushes: bool):
    """The others alone would turn the hull."""
    sound, command, reference = at_work(np.random.default_rng(2), 0.0)
    sound = replace(sound, X_WB=np.eye(4))
    reference = replace(reference, X_WG=pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3)))  # the surface lies below
    full = np.array(command.thrusters)
    full[VEHICLE.thruster_names.index(name)] = 1.0
    command = replace(command, thrusters=full)
    leave, _ = stages(sound, reference, command)
    more = VEHICLE.thruster_wrench @ (thrusts(leave.thrusters) - thrusts(full))
    assert more == pytest.approx([0.0, 0.0, PUSH if pushes else 0.0, 0.0, 0.0, 0.0], abs=1e-9)


def test_a_lost_thruster_is_left_alone():
    sound, command, reference = at_work(np.random.default_rng(3), 40.0)
    lost = VEHICLE.thruster_names.index("heave_front")
    reference = replace(reference, lost_thrusters=(lost,))
    for stage in stages(sound, reference, command):
        assert stage.thrusters[lost] == pytest.approx(command.thrusters[lost], abs=1e-9)
        assert not np.allclose(np.delete(stage.thrusters, lost), np.delete(command.thrusters, lost), atol=1e-3)


def test_what_swings_about_a_mean_departs_from_the_mean():
    """Thrusts and contact that swing together, as in the moments before an estimate is lost."""
    sound, command, reference = at_work(np.random.default_rng(5), 30.0)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    swung = []
    for k in range(1200):
        swing = np.sin(2.0 * np.pi * k * DT / 0.2)
        contact = ContactEstimate(force_W=(1.0 + 0.3 * swing) * command.contact.force_W, normal=30.0)
        thrusters = command.thrusters * (1.0 + 0.1 * swing)
        swung.append(replace(command, time=k * DT, thrusters=thrusters, contact=contact))
    leave, _ = stages(sound, reference, *swung)
    mean = np.mean([thrusts(one.thrusters) for one in swung[-20:]], axis=0)  # of the last period
    at_tip = np.zeros(6)
    at_tip[:3] = sound.X_WB[:3, :3].T @ command.contact.force_W
    at_tip[3:] = np.cross(ARM.tip(sound.q)[0][:3, 3], at_tip[:3])
    wrench = VEHICLE.thruster_wrench @ (thrusts(leave.thrusters) - mean) - at_tip
    push = np.append(PUSH * (sound.X_WB[:3, :3].T @ off_W), np.zeros(3))
    last = VEHICLE.thruster_wrench @ (thrusts(swung[-5].thrusters) - mean)  # what the mean spares, at a crest
    assert np.abs(wrench - push).max() < 0.1 * np.abs(last).max()  # 0.053 measured


def test_a_contact_that_becomes_known_counts_from_then_on():
    sound, command, reference = at_work(np.random.default_rng(6), 30.0)
    unknown = replace(command, contact=ContactEstimate())
    later = replace(command, time=DT, thrusters=np.array(command.thrusters))
    known, as_known = stages(sound, reference, unknown, later), stages(sound, reference, command)
    for one, other in zip(known, as_known, strict=True):
        assert np.allclose(one.thrusters, other.thrusters, rtol=0.0, atol=1e-12)


def test_the_wrapper_leaves_then_rises_then_stops():
    """Without a tool pose it stops at once."""
    sound, command, reference = at_work(np.random.default_rng(4), 40.0)

    class Steady:
        period = DT

        def init(self, estimate: StateEstimate) -> None:
            del estimate

        def step(self, state: None, estimate: StateEstimate, reference: Reference) -> tuple[None, Command]:
            del estimate, reference
            return state, command

    sent = {}
    for name, given_reference in (("near", reference), ("away", replace(reference, X_WG=None))):
        wrapper = SafetyWrapper(Steady(), MODEL)
        state = wrapper.init(sound)
        state, _ = wrapper.step(state, sound, given_reference)
        blind = replace(sound, a_WB_B=np.full(3, np.nan))
        commands = []
        for _ in range(round(14.0 / DT)):
            state, one = wrapper.step(state, blind, given_reference)
            commands.append(one.thrusters)
        sent[name] = np.array(commands)[round(0.05 / DT) :]
    leave, rise = stages(sound, reference, command)
    near, margin = sent["near"], round(0.1 / DT)  # patience and the steps left out above
    rises, stops = round(leave.until / DT), round(rise.until / DT)
    assert np.all(near[: rises - margin] == leave.thrusters)
    assert np.all(near[rises : stops - margin] == rise.thrusters)
    assert near[: stops - margin].any(axis=1).all()
    assert not near[stops:].any()
    assert not sent["away"].any()
