"""Blind departure: the thrusts balance what they did without the contact, and push off the surface,
then up.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.safety.blind_departure import (
    BlindDeparture,
    DepartureStage,
    HeldHull,
    ascent_direction,
    follow,
)
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.tuning import HULL, SAFETY
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import FORWARD, curves
from uuv.sim.interfaces.kernels.control import commanded
from uuv.sim.interfaces.messages import (
    Command,
    ContactEstimate,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.records import reference_record, take_reference
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

MODEL = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(MODEL)
ARM = ArmDynamics(MODEL)
PUSH = SAFETY.leave_acceleration * float(MODEL.body_subtreemass[VEHICLE.hull])
N, M = len(VEHICLE.joints), len(VEHICLE.thruster_names)
DT = 0.01


def at_work(rng: np.random.Generator, force: float) -> tuple[StateEstimate, Command, Reference]:
    """Hull and arm at random, pressed with `force` [N] at random thrusts of up to a tenth of full
    ones.
    """
    X_WB = pose(exp_so3(0.3 * rng.standard_normal(3)), rng.standard_normal(3))
    q = np.array(VEHICLE.q_ready) + 0.1 * rng.standard_normal(N)
    X_WG = X_WB @ ARM.tip(q)[0]
    sound = StateEstimate(
        time=0.0,
        X_WB=X_WB,
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=q,
        qd=np.zeros(N),
        tau=np.zeros(N),
    )
    force_W = X_WG[:3, :3] @ [*(0.1 * force * rng.standard_normal(2)), -force]
    command = Command(
        time=0.0,
        joint_torque=np.zeros(N),
        thrusters=rng.uniform(-0.3, 0.3, M),
        scan=False,
        contact=ContactEstimate(force_W=force_W, normal=force),
    )
    reference = Reference.holding(
        0.0, X_WB, np.zeros(N), state=WorkState.WORK, X_WG=X_WG, set_force=force, force_control=True
    )
    return sound, command, reference


def stages(
    sound: StateEstimate, reference: Reference, *commands: Command
) -> tuple[DepartureStage, ...]:
    """Stages after `commands`."""
    held = held_by(reference, *commands)
    return BlindDeparture(MODEL, VEHICLE, ARM).stages(held, sound, reference.lost_thrusters)


def held_by(reference: Reference, *commands: Command) -> HeldHull:
    """What holds the hull after `commands`."""
    held, measured, thrust = HeldHull.start(M), commanded(N, M), curves(VEHICLE.thruster_table)
    request = reference_record(N)
    take_reference(request, reference)
    for command in commands:
        measured.thrusters[:], measured.f_W[:] = command.thrusters, command.contact.force_W
        follow(thrust, SAFETY.balance_time, measured, request, command.time, held)
    return held


def thrusts(commands: Array) -> Array:
    """Steady thrusts (m,) [N] in still water."""
    table = VEHICLE.thruster_table
    return np.array(
        [thrust_at(curve, one) for curve, one in zip(curves(table), commands, strict=True)]
    )


def pushed(sound: StateEstimate, command: Command, contact_W: Array, thrusters: Array) -> Array:
    """Wrench (6,), hull axes, that `thrusters` give beyond those of `command`, with the contact
    gone.
    """
    at_tip = np.zeros(6)
    at_tip[:3] = sound.X_WB[:3, :3].T @ contact_W
    at_tip[3:] = np.cross(ARM.tip(sound.q)[0][:3, 3], at_tip[:3])
    return VEHICLE.thruster_wrench @ (thrusts(thrusters) - thrusts(command.thrusters)) - at_tip


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), force=st.floats(0.0, 40.0))
def test_the_hull_is_held_without_the_contact_and_pushed_off_the_surface_then_up(
    seed: int, force: float
):
    sound, command, reference = at_work(np.random.default_rng(seed), force)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    up_W = ascent_direction(off_W) / np.linalg.norm(ascent_direction(off_W))
    departure = stages(sound, reference, command)
    assert [stage.until for stage in departure] == [
        SAFETY.leave_time,
        SAFETY.leave_time + SAFETY.rise_time,
    ][: len(departure)]
    assert len(departure) == (2 if up_W[2] > 0.0 else 1)
    for stage, along_W in zip(departure, (off_W, up_W), strict=False):
        wrench = pushed(sound, command, command.contact.force_W, stage.thrusters)
        # The push, no other force, and no moment: the hull's balance stays what it was. Measured:
        # 5e-14.
        push = np.append(PUSH * (sound.X_WB[:3, :3].T @ along_W), np.zeros(3))
        assert np.allclose(wrench, push, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("unknown", [ContactEstimate(), ContactEstimate(normal=40.0)])
def test_an_unknown_contact_counts_as_the_set_force(unknown: ContactEstimate):
    sound, command, reference = at_work(np.random.default_rng(1), 40.0)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    leave = stages(sound, reference, replace(command, contact=unknown))[0]
    wrench = pushed(sound, command, 40.0 * off_W, leave.thrusters)
    assert np.allclose(
        wrench, np.append(PUSH * (sound.X_WB[:3, :3].T @ off_W), np.zeros(3)), rtol=0.0, atol=1e-9
    )


def test_a_force_where_none_is_meant_to_be_does_not_count():
    """Bias of the torque sensors before the tare: the thrusts did not balance it."""
    sound, command, reference = at_work(np.random.default_rng(1), 40.0)
    assert reference.X_WG is not None
    leave = stages(sound, replace(reference, set_force=0.0, force_control=False), command)[0]
    wrench = pushed(sound, command, np.zeros(3), leave.thrusters)
    off_B = sound.X_WB[:3, :3].T @ -reference.X_WG[:3, 2]
    assert np.allclose(wrench, np.append(PUSH * off_B, np.zeros(3)), rtol=0.0, atol=1e-9)


def test_full_thrusters_give_up_the_push_before_they_tilt_the_hull():
    sound, command, reference = at_work(np.random.default_rng(2), 0.0)
    heave = [name.startswith("heave") for name in VEHICLE.thruster_names]
    command = replace(command, thrusters=np.where(heave, 0.97, command.thrusters))
    rise = stages(sound, reference, command)[-1]
    wrench = pushed(sound, command, command.contact.force_W, rise.thrusters)
    table = VEHICLE.thruster_table
    assert thrusts(rise.thrusters).max() == pytest.approx(HULL.headroom * table[:, FORWARD].max())
    assert np.abs(wrench[3:5]).max() < 1e-6
    assert wrench[2] < 0.5 * PUSH  # a rise asks for nearly all of it along the hull's z


def test_a_lost_thruster_is_not_used():
    sound, command, reference = at_work(np.random.default_rng(3), 40.0)
    lost = VEHICLE.thruster_names.index("heave_front")
    for stage in stages(sound, replace(reference, lost_thrusters=(lost,)), command):
        assert stage.thrusters[lost] == 0.0
        assert np.delete(stage.thrusters, lost).any()


def test_with_the_arm_folded_or_without_one_the_hull_rises_and_is_braked_first():
    sound, command, reference = at_work(np.random.default_rng(3), 0.0)
    v_B = np.array([0.2, -0.1, 0.0])
    sound = replace(sound, q=np.array(VEHICLE.q_home) + 0.1, v_WB_B=v_B)
    up_B = sound.X_WB[:3, :3].T @ [0.0, 0.0, 1.0]
    brake = PUSH / SAFETY.leave_acceleration * v_B / SAFETY.leave_time
    held, without_arm = held_by(reference, command), BlindDeparture(MODEL, VEHICLE, None)
    for found in (stages(sound, reference, command), without_arm.stages(held, sound, ())):
        for stage, force_B in zip(found, (PUSH * up_B - brake, PUSH * up_B), strict=True):
            wrench = pushed(sound, command, np.zeros(3), stage.thrusters)
            assert np.allclose(wrench, np.append(force_B, np.zeros(3)), rtol=0.0, atol=1e-9)


def test_nothing_departs_before_the_first_command():
    sound, _, reference = at_work(np.random.default_rng(3), 40.0)
    assert stages(sound, reference) == ()


def test_off_an_overhang_the_hull_does_not_rise():
    for tilt, count in ((0.0, 2), (np.pi / 2.0, 2), (np.pi, 1)):
        sound, command, reference = at_work(np.random.default_rng(3), 0.0)
        tool_axis = sound.X_WB[:3, :3] @ ARM.tip(sound.q)[0][:3, :3]
        # z of the tool down, across, up
        rotation = exp_so3(np.array([tilt, 0.0, 0.0])) @ np.diag([1.0, -1.0, -1.0])
        sound = replace(sound, X_WB=pose(rotation @ tool_axis.T @ sound.X_WB[:3, :3], np.zeros(3)))
        assert len(stages(sound, reference, command)) == count


def test_what_swings_about_a_mean_departs_from_the_mean():
    """Thrusts and contact that swing together, as in the moments before an estimate is lost."""
    sound, command, reference = at_work(np.random.default_rng(5), 30.0)
    assert reference.X_WG is not None
    off_W = -reference.X_WG[:3, 2]
    swung = []
    for k in range(1200):
        swing = np.sin(2.0 * np.pi * k * DT / 0.2)
        contact = ContactEstimate(
            force_W=(1.0 + 0.3 * swing) * command.contact.force_W, normal=30.0
        )
        thrusters = command.thrusters * (1.0 + 0.1 * swing)
        swung.append(replace(command, time=k * DT, thrusters=thrusters, contact=contact))
    leave = stages(sound, reference, *swung)[0]
    mean = np.mean([thrusts(one.thrusters) for one in swung[-20:]], axis=0)  # of the last period
    at_tip = np.zeros(6)
    at_tip[:3] = sound.X_WB[:3, :3].T @ command.contact.force_W
    at_tip[3:] = np.cross(ARM.tip(sound.q)[0][:3, 3], at_tip[:3])
    wrench = VEHICLE.thruster_wrench @ (thrusts(leave.thrusters) - mean) - at_tip
    push = np.append(PUSH * (sound.X_WB[:3, :3].T @ off_W), np.zeros(3))
    # what the mean spares, at a crest
    last = VEHICLE.thruster_wrench @ (thrusts(swung[-5].thrusters) - mean)
    assert np.abs(wrench - push).max() < 0.1 * np.abs(last).max()  # 0.044 measured


@dataclass
class Steady:
    """A controller that sends one command."""

    command: Command
    period: float = DT

    def init(self, estimate: StateEstimate) -> None:
        del estimate

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        del estimate, reference
        return state, self.command


def wrapped(
    sound: StateEstimate,
    command: Command,
    reference: Reference,
    *blind: StateEstimate,
    lead: int = 1,
) -> Array:
    """Thrusters (k, m) that the wrapper sends for `lead` sound estimates, then for those
    `blind`.
    """
    wrapper = SafetyWrapper(Steady(command), MODEL)
    state, sent = wrapper.init(sound if lead else blind[0]), list[Array]()
    for one in (*[replace(sound, time=k * DT) for k in range(lead)], *blind):
        state, given_command = wrapper.step(state, one, reference)
        sent.append(given_command.thrusters)
    assert np.isfinite(sent).all()
    return np.array(sent)


def test_the_wrapper_leaves_then_rises_then_stops():
    sound, command, reference = at_work(np.random.default_rng(4), 40.0)
    leave, rise = stages(sound, reference, command)
    near = wrapped(
        sound, command, reference, *[replace(sound, a_WB_B=np.full(3, np.nan))] * round(14.0 / DT)
    )
    near = near[round(0.06 / DT) :]
    rises, stops, margin = round(leave.until / DT), round(rise.until / DT), round(0.1 / DT)
    assert np.all(near[: rises - margin] == leave.thrusters)
    assert np.all(near[rises : stops - margin] == rise.thrusters)
    assert near[: stops - margin].any(axis=1).all()
    assert not near[stops:].any()


def test_an_estimate_without_a_time_departs_although_the_task_has_halted_by_then():
    """The task gives up the tool pose within the wrapper's patience."""
    sound, command, reference = at_work(np.random.default_rng(4), 40.0)
    halted = replace(reference, X_WG=None, set_force=0.0, force_control=False)
    wrapper = SafetyWrapper(Steady(command), MODEL)
    state = wrapper.init(sound)
    state, _ = wrapper.step(state, sound, reference)
    for _ in range(10):
        state, _ = wrapper.step(state, replace(sound, time=np.nan), halted)
    sent = wrapper.step(state, replace(sound, time=np.nan), halted)[1]
    assert np.array_equal(sent.thrusters, stages(sound, reference, command)[0].thrusters)


def test_an_estimate_that_was_never_sound_stops():
    sound, command, reference = at_work(np.random.default_rng(4), 40.0)
    blind = replace(sound, q=np.full(N, np.nan))
    assert not wrapped(sound, command, reference, *[blind] * 50, lead=0).any()
