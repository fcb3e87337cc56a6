"""The work controller as a composition: other parts handed in, state that is owned, threads that
share a controller.
"""

import sys
import threading
from dataclasses import fields, replace
from itertools import combinations
from typing import get_args

import numpy as np
import pytest

from uuv import models
from uuv.components.ablations import ablated
from uuv.components.contact_parts import FORCE_PARTS, as_published, controller
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.position_force import ForceDisplacement
from uuv.controllers.estimation.load_observer import MomentumObserver
from uuv.controllers.estimation.tip_force_estimator import DriveState
from uuv.controllers.hull.feedforward import WithoutCompensation
from uuv.controllers.mkps import Chain
from uuv.controllers.whole_body.work_controller import WorkController, WorkControllerState
from uuv.methods import FORCE_LAWS, PublishedMethod
from uuv.models.arms.gear_friction import DryFriction
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.scenario import Control
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.options import about_of
from uuv.sim.interfaces.spatial import exp_so3, pose

OWN = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(OWN)
ARM = ArmDynamics(OWN)
N = VEHICLE.joints.size
CHAIN = Chain.from_mjcf(
    OWN,
    ARM_BASE_BODY,
    TIP_SITE,
    exclude=[
        OWN.joint(j).name
        for j in range(OWN.njnt)
        if j not in VEHICLE.joints and OWN.jnt_type[j] != 0
    ],
)
STILL = np.zeros(3)
DT = 0.002
METHODS = (
    "compensation",
    "hydrodynamic-term",
    "dynamic-term",
    "contact-term",
    "drift-correction",
    "force-control",
)


def inputs(seed: int, steps: int) -> list[tuple[StateEstimate, Reference]]:
    """A drifting hull and a moving arm that presses after a third of the steps, with noise."""
    rng = np.random.default_rng(seed)
    start = VEHICLE.q_ready + rng.uniform(-0.1, 0.1, N)
    rate = rng.uniform(-0.2, 0.2, N)
    at_rest = {"R_WB": np.eye(3), "nu_B": np.zeros(6), "a_B": np.zeros(6), "v_current_W": STILL}
    push_G = np.array([5.0, -3.0, -40.0, 0.0, 0.0, 0.0])
    tau = ARM.inverse(start, np.zeros(N), np.zeros(N), wrench_tip_G=push_G, **at_rest)[0]
    rows = []
    for i in range(steps):
        t = DT * i
        X_WB = pose(exp_so3(0.02 * np.sin(t + np.arange(3))), 0.03 * np.sin(2.0 * t + np.arange(3)))
        estimate = StateEstimate(
            time=t,
            X_WB=X_WB,
            v_WB_B=0.01 * rng.standard_normal(3),
            w_WB_B=0.01 * rng.standard_normal(3),
            a_WB_B=0.1 * rng.standard_normal(3),
            q=start + t * rate,
            qd=rate + 1e-3 * rng.standard_normal(N),
            tau=tau + 0.1 * rng.standard_normal(N),
        )
        presses = i > steps // 3
        X_WG = VEHICLE.X_BA @ CHAIN_TIP
        reference = Reference.holding(
            t,
            np.eye(4),
            start,
            state=WorkState.WORK,
            X_WG=X_WG if presses else None,
            set_force=40.0 if presses else 0.0,
            force_control=presses,
        )
        rows.append((estimate, reference))
    return rows


def tip_in_base() -> np.ndarray:
    X_BG, _ = ARM.tip(np.array(VEHICLE.q_ready))
    return np.linalg.inv(VEHICLE.X_BA) @ X_BG


CHAIN_TIP = tip_in_base()


def commands(controller: WorkController, rows: list[tuple[StateEstimate, Reference]]) -> np.ndarray:
    """Torques, thrusters and force of every step."""
    state = controller.init(rows[0][0])
    out = []
    for estimate, reference in rows:
        state, command = controller.step(state, estimate, reference)
        out.append(row(command))
    return np.array(out)


def row(command: Command) -> np.ndarray:
    return np.concatenate(
        [command.joint_torque, command.thrusters, [command.contact.normal], command.contact.force_W]
    )


class Integrator(ForceDisplacement):
    """Force law of fixed gain."""

    def step(self, state, set_force, felt, servo_compliance, dt):
        state.k += 1e-4 * (set_force - felt) * dt  # [m]
        return state.k


def test_a_force_law_is_replaced_alone(within):
    """Its displacement is the one of the law, by hand; the thrusters do not notice."""
    rows = inputs(1, 300)
    k = 0.0
    torques = []
    controller = WorkController(OWN, force_law=Integrator())
    plain = WorkController(OWN)
    state, other = controller.init(rows[0][0]), plain.init(rows[0][0])
    for i, (estimate, reference_of) in enumerate(rows):
        state, command = controller.step(state, estimate, reference_of)
        other, usual = plain.step(other, estimate, reference_of)
        if reference_of.force_control and i % 2 == 0:
            k += 1e-4 * (reference_of.set_force - command.contact.normal) * 0.004
        if i % 10 == 0:  # the controller reports it with each step of the hull
            within("displacement [m]", command.believed["displacement"] - k, 1e-15)
        assert np.array_equal(command.thrusters, usual.thrusters)
        torques.append(command.joint_torque - usual.joint_torque)
    assert abs(k) > 1e-5
    assert np.abs(torques).max() > 1e-3


def test_one_controller_steps_two_states_in_two_threads():
    """Their commands are those of one after the other, bit for bit: nothing of a step is left in
    the controller.
    """
    controller = WorkController(OWN)
    work = [inputs(seed, 600) for seed in (1, 2)]
    alone = [commands(controller, rows) for rows in work]
    together: list[np.ndarray] = [np.empty(0), np.empty(0)]

    def run(k: int) -> None:
        together[k] = commands(controller, work[k])

    threads = [threading.Thread(target=run, args=(k,)) for k in range(2)]
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # [s] a switch within nearly every step
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(usual)
    assert not np.array_equal(alone[0], alone[1])
    for k in range(2):
        assert np.array_equal(together[k], alone[k])


def test_states_taken_in_turn_do_not_mix():
    controller = WorkController(OWN)
    work = [inputs(seed, 60) for seed in (3, 4)]
    alone = [commands(controller, rows) for rows in work]
    states: list[WorkControllerState] = [controller.init(rows[0][0]) for rows in work]
    for i in range(60):
        for k in range(2):
            states[k], command = controller.step(states[k], *work[k][i])
            assert np.array_equal(row(command), alone[k][i])


@pytest.mark.parametrize("method", METHODS)
def test_each_method_left_out_changes_the_command_it_is_about(method):
    """On given estimates those of the tool change the torques and leave the thrusters; the others
    change both.
    """
    rows = [(replace(e, tau=1.01 * e.tau), r) for e, r in inputs(5, 200)]
    usual = commands(WorkController(OWN), rows)
    changed = commands(WorkController(OWN, **ablated({method}, OWN, 0.0)), rows)
    of_the_tool = method in ("drift-correction", "force-control")
    assert np.array_equal(usual[:, N:-4], changed[:, N:-4]) == of_the_tool
    assert not np.array_equal(usual[:, :N], changed[:, :N])


class HomeAlone:
    """`WithoutCompensation` in plain Python."""

    def __init__(self, home_B: np.ndarray) -> None:
        self.home_B = home_B
        self.seen = []

    def left_out(self, load, contact, estimate):
        self.seen.append(estimate.time)
        return load.wrench_B - self.home_B


def test_a_feedforward_has_the_same_bits_as_kernel_and_in_python():
    """It is called at each step of the hull, with the estimate of that tick, and is named."""
    rows = inputs(7, 60)
    q_home = np.array(VEHICLE.q_home)
    arm = ArmDynamics(OWN)
    compiled = WorkController(OWN, feedforward=WithoutCompensation(arm, q_home))
    plain = HomeAlone(arm.wrench_at_rest(q_home))
    python = WorkController(OWN, feedforward=plain)
    first, other = commands(compiled, rows), commands(python, rows)
    assert np.array_equal(first, other)
    assert plain.seen == [estimate.time for estimate, _ in rows[::10]]
    assert (compiled.slow, python.slow) == ((), ("HomeAlone",))
    assert not np.array_equal(first, commands(WorkController(OWN), rows))


def test_what_a_feedforward_raises_comes_out_as_it_is():
    controller = WorkController(OWN, feedforward=HomeAlone(np.zeros(7)))
    with pytest.raises(ValueError, match="broadcast"):
        commands(controller, inputs(7, 2))


def test_nothing_left_out_is_the_usual_controller():
    assert ablated(frozenset(), OWN, 0.15) == as_published(frozenset(), OWN, 0.15) == {}


def test_every_published_force_law_has_its_parts_and_a_run_has_one_of_them():
    assert tuple(FORCE_PARTS) == FORCE_LAWS
    for first, second in combinations(FORCE_LAWS, 2):
        with pytest.raises(ConfigurationError, match="give only one of them") as refused:
            Control(published=(first, second))
        assert all(law in str(refused.value) for law in FORCE_LAWS)
    about = next(about_of(entry) for entry in fields(Control) if entry.name == "published")
    assert all(method in about for method in get_args(PublishedMethod))


@pytest.mark.parametrize("method", [*FORCE_LAWS, "tip-force"])
def test_each_published_method_changes_the_torques(method):
    rows = [(replace(e, tau=1.01 * e.tau), r) for e, r in inputs(5, 200)]
    usual = commands(WorkController(OWN), rows)
    changed = commands(WorkController(OWN, **as_published({method}, OWN, 0.0)), rows)
    assert not np.array_equal(usual[:, :N], changed[:, :N])
    assert np.isfinite(changed).all()


def test_the_momentum_observer_reads_no_torque_sensor():
    rows = inputs(6, 100)
    deaf = [(replace(e, tau=np.zeros(N)), r) for e, r in rows]
    first, second = (
        commands(WorkController(OWN, estimator=MomentumObserver(OWN)), r) for r in (rows, deaf)
    )
    assert np.array_equal(first, second)
    assert np.abs(first[-1, -4:]).max() > 0.1


def test_the_force_of_any_job_may_come_from_the_motors():
    def commanded(control: Control, sensors: bool) -> np.ndarray:
        chosen = controller(control, OWN, water_error=0.0)
        rows = [(e if sensors else replace(e, tau=np.zeros(N)), r) for e, r in inputs(6, 100)]
        state = chosen.init(rows[0][0])
        forces = []
        for estimate, reference in rows:
            state, command = chosen.step(state, estimate, reference)
            forces.append(command.contact.force_W)
        return np.array(forces[-20:])

    motors = Control(force_from="motors")
    np.testing.assert_array_equal(commanded(motors, True), commanded(motors, False))
    assert not np.allclose(commanded(Control(), True), commanded(Control(), False))
    with pytest.raises(ConfigurationError, match=r"force_from motors .* tip-force: give only one"):
        Control(force_from="motors", published=("tip-force",))


def test_motors_with_dry_gear_friction_take_no_tare():
    """At rest the gears may hold anything below stiction, which a tare would take for its zero."""
    frictionless = DryFriction(
        coulomb=np.zeros(N), stiction=np.zeros(N), stribeck_speed=np.full(N, 0.1)
    )
    for friction, tared in ((None, False), (frictionless, True)):
        observer = MomentumObserver(OWN, friction=friction)
        (estimate, reference), *_ = inputs(7, 1)
        state = observer.init(estimate)
        drives = DriveState(
            tau=np.full(N, 3.0), qd_wanted=np.zeros(N), current_W=np.array([0.1, 0.0, 0.0])
        )
        for _ in range(20):
            observer.step(state, estimate, replace(reference, tare=True), drives)
        assert bool(np.any(state.bias)) is tared


def test_the_length_law_takes_friction_for_pressure():
    """Two contact forces of one normal part: only the law by the text tells them apart."""

    def displaced(law: str, friction: float) -> float:
        chosen = WorkController(OWN, **as_published({law}, OWN, 0.0))
        push_G = np.array([friction, 0.0, -50.0, 0.0, 0.0, 0.0])
        q = np.array(VEHICLE.q_ready)
        X_WB = pose(exp_so3([0.1, -0.2, 0.7]), [1.0, 2.0, -3.0])
        at_rest = {"R_WB": X_WB[:3, :3], "nu_B": np.zeros(6), "a_B": np.zeros(6)}
        tau = ARM.inverse(
            q, np.zeros(N), np.zeros(N), wrench_tip_G=push_G, v_current_W=STILL, **at_rest
        )[0]
        estimate = replace(inputs(1, 1)[0][0], X_WB=X_WB, q=q, qd=np.zeros(N), tau=tau)
        estimate = replace(estimate, v_WB_B=STILL, w_WB_B=STILL, a_WB_B=STILL)
        X_WG = X_WB @ VEHICLE.X_BA @ CHAIN.forward(q)
        reference = Reference.holding(
            0.0, X_WB, q, state=WorkState.WORK, X_WG=X_WG, set_force=60.0, force_control=True
        )
        state = chosen.init(estimate)
        for _ in range(200):
            state, _ = chosen.step(state, estimate, reference)
        return state.tool.k

    for law, blind in (("normal-force-law", True), ("force-length-law", False)):
        assert (abs(displaced(law, 0.0) - displaced(law, 30.0)) < 1e-4) is blind
