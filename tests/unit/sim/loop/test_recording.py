"""A recording holds what was shown to the recorder, at the rates that were asked for."""

from dataclasses import replace
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from at_rest import at_rest
from uuv import models
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, ContactEstimate, Reference, Target, WorkState
from uuv.sim.interfaces.spatial import (
    exp_so3,
    pose,
    quat_wxyz_from_rotation,
    rotation_from_quat_wxyz,
)
from uuv.sim.loop.logged_columns import EVERY_STEP
from uuv.sim.loop.recording import Recorder, Recording, write_row
from uuv.sim.loop.rollout import Moment
from uuv.sim.plant.jaw_drive import TrueJaws
from uuv.sim.plant.true_handle import TrueHandle

MODEL = models.load("uuv_puma").compile()
DT = float(MODEL.opt.timestep)
PLANNER_TICKS = 5


class Run:
    """Steps a made-up truth whose arrays, like the plant's, are views that the next step
    overwrites.
    """

    def __init__(self) -> None:
        self.truth = SimpleNamespace(
            time=0.0,
            contact_normal=0.0,
            contact_least=0.0,
            contact_most=0.0,
            saturated=False,
            collision=False,
            collided=np.full(3, -1.0),
            p_pad=np.zeros(3),
            R_WG=np.eye(3),
            p_WB=np.zeros(3),
            contact_force_W=np.zeros(3),
            xpos=np.zeros((MODEL.nbody, 3)),
            xquat=np.tile([1.0, 0.0, 0.0, 0.0], (MODEL.nbody, 1)),
            q=np.zeros(6),
            qd=np.zeros(6),
            tau_drive=np.zeros(6),
            thrust=np.zeros(6),
            current_W=np.zeros(3),
            jaws=TrueJaws(opening=np.zeros(0), speed=np.zeros(0), force=np.zeros(0)),
            arm_wrench_B=np.zeros(6),
            handle=TrueHandle(angle=np.zeros(0), speed=np.zeros(0), borne=np.zeros(0)),
            supply=np.zeros(0),
        )
        self.target: Target | None = None
        self.X_WB = np.eye(4)  # estimated
        self.held = False  # no new references
        self.reference: Reference | None = None

    def hold(self, recorder: Recorder, steps: int) -> None:
        """Show steps with the last reference."""
        self.held = True
        self.show(recorder, steps)
        self.held = False

    def show(
        self, recorder: Recorder, steps: int, state: WorkState = WorkState.WORK, note: str = ""
    ) -> None:
        truth = self.truth
        first = round(truth.time / DT) if self.reference else 0
        for tick in range(first, first + steps):
            truth.time = tick * DT
            truth.p_pad[:] = tick
            truth.contact_normal = 0.5 * tick
            truth.contact_least, truth.contact_most = 0.25 * tick, 1.0 * tick
            truth.q[:] = tick
            truth.xpos[:] = tick
            if self.reference is None or (tick % PLANNER_TICKS == 0 and not self.held):
                self.reference = Reference(
                    time=truth.time,
                    state=state,
                    X_WB=np.eye(4),
                    v_WB_W=np.zeros(3),
                    X_WG=pose(p=[truth.time, 2.0, 3.0]),
                    v_WG_W=np.array([1.0, 0.0, 0.0]),
                    w_WG_W=np.zeros(3),
                    q=np.zeros(6),
                    qd=np.zeros(6),
                    set_force=60.0,
                    force_control=True,
                    tare=False,
                    scan=False,
                    path_s=0.1,
                    note=note,
                )
            estimate = at_rest(time=truth.time, X_WB=self.X_WB)
            command = Command(
                time=truth.time,
                joint_torque=np.zeros(6),
                thrusters=np.zeros(6),
                scan=False,
                contact=ContactEstimate(force_W=np.full(3, float(tick)), normal=float(tick)),
            )
            recorder.observe(
                Moment(tick, truth, estimate, self.target, self.reference, command, None, None)
            )
        truth.time += DT


def recorded(steps: int, full: bool = True) -> Recording:
    recorder = Recorder(MODEL, full=full)
    Run().show(recorder, steps)
    return recorder.recording()


def test_every_step_is_kept_past_the_first_block_and_not_as_a_view():
    steps = (1 << 15) + 100
    recording = recorded(steps)
    assert np.array_equal(recording["p_pad"].value[:, 1], np.arange(steps))
    assert np.array_equal(recording["contact_normal"].scalar, 0.5 * np.arange(steps))
    assert np.array_equal(recording["contact_least"].scalar, 0.25 * np.arange(steps))
    assert np.array_equal(recording["contact_most"].scalar, np.arange(steps))
    assert np.allclose(recording["p_pad"].time, DT * np.arange(steps))
    assert recording.duration == pytest.approx(steps * DT)


def test_commanded_tip_is_carried_on_between_references():
    recording = recorded(23)
    command = recording["p_command"]
    assert np.allclose(
        command.value, np.column_stack([command.time, np.full(23, 2.0), np.full(23, 3.0)])
    )


def test_the_first_collision_is_told_by_names():
    recorder = Recorder(MODEL)
    run = Run()
    run.show(recorder, 3)
    assert recorder.recording().collided == ""
    run.truth.collided[:] = MODEL.geom("pad").id, 0, 1.26
    assert recorder.recording().collided == "'pad' met 'hull_box' of 'hull' at 1.3 s"


def test_slow_series_keep_their_rates():
    recording = recorded(500)
    assert np.allclose(np.diff(recording["q"].time), 0.02)
    assert np.allclose(np.diff(recording["body_pose"].time), 0.04)
    assert recording["q"].labels == tuple(f"joint{i}" for i in range(1, 7))
    assert np.array_equal(recording["q"].value[:, 0], np.arange(0, 500, 10))
    assert np.array_equal(recording["believed.f_tip_W"].value[:, 2], np.arange(0, 500, 10))


def test_metrics_only_leaves_the_slow_series_out():
    recording = recorded(20, full=False)
    assert "p_pad" in recording
    assert "q" not in recording
    with pytest.raises(ConfigurationError, match=r"no series 'q'.*p_pad"):
        recording["q"]


def test_states_and_targets_are_kept_once_each():
    recorder = Recorder(MODEL)
    run = Run()
    run.show(recorder, 50, WorkState.SCAN)
    run.target = Target(
        time=0.1, X_WT=np.eye(4), accepted=True, check_m=0.0, range_m=1.0, reason="", path=None
    )
    run.show(recorder, 50, WorkState.WORK)
    run.show(recorder, 50, WorkState.RETREAT, note="felt too much")
    recording = recorder.recording()
    assert [(event.state, event.note) for event in recording.events] == [
        (WorkState.SCAN, ""),
        (WorkState.WORK, ""),
        (WorkState.RETREAT, "felt too much"),
    ]
    assert recording.final.time == pytest.approx(100 * DT)
    assert len(recording.targets) == 1
    assert recording.within(WorkState.WORK, WorkState.RETREAT).sum() == 100


def test_digest_is_of_every_bit_of_the_trajectory():
    recording = recorded(50)
    assert recording.digest() == recorded(50).digest() == recorded(50, full=False).digest()
    assert recording.digest() != recorded(51).digest()
    assert recording.digest(["p_pad", "state"]) == recording.digest(("state", "p_pad"))
    for name in EVERY_STEP:
        series = recording[name]
        altered = series.value.copy()
        altered[17, -1] = np.nextafter(altered[17, -1], np.inf)  # NaN stays
        changed = replace(
            recording, series={**recording.series, name: replace(series, value=altered)}
        )
        assert (changed.digest() == recording.digest()) == np.array_equal(
            altered, series.value, equal_nan=True
        ), name


def test_quaternions_keep_their_sign_through_two_turns():
    """q and -q are one rotation: what differentiates or interpolates the series must not meet a
    jump.
    """
    recorder = Recorder(MODEL)
    run = Run()
    start = exp_so3([0.4, -0.3, 0.2])
    angles = np.linspace(0.0, 4.0 * np.pi, 81)
    turned = [exp_so3(angle * np.array([0.48, -0.6, 0.64])) @ start for angle in angles]
    ticks = round(0.04 / DT)  # of the slowest rows
    for number, R in enumerate(turned):
        quat = quat_wxyz_from_rotation(R)
        # an estimate may lack numbers
        run.X_WB = pose(np.full((3, 3), np.nan) if number == 33 else R)
        run.truth.xquat[:] = quat if number % 3 else -quat
        run.show(recorder, ticks)

    recording = recorder.recording()
    poses = recording["body_pose"].value.reshape(81, MODEL.nbody, 7)
    estimated = recording["quat_WB_estimate_wxyz"].value
    assert np.isnan(estimated[2 * 33 : 2 * 34]).all()
    for quats, rotations in (
        (recording["quat_WB_wxyz"].value[::ticks], turned),
        (np.delete(estimated[::2], 33, axis=0), [*turned[:33], *turned[34:]]),
        (poses[:, 5, 3:], turned),
    ):
        assert np.sum(quats[1:] * quats[:-1], axis=1).min() > 0.9
        assert np.allclose([rotation_from_quat_wxyz(quat) for quat in quats], rotations, atol=1e-12)


def test_recording_is_frozen():
    recording = recorded(10)
    for series in recording.series.values():
        with pytest.raises(ValueError, match="read-only"):
            series.value[0] = 1.0


def test_what_cannot_be_kept_is_refused():
    with pytest.raises(ConfigurationError, match="no step yet"):
        Recorder(MODEL).recording()
    with pytest.raises(ConfigurationError, match="whole multiple"):
        Recorder(MODEL, period=0.003)
    with pytest.raises(ConfigurationError, match="recorder's timestep"):
        Recorder(MODEL, timestep=0.0025)
    with pytest.raises(ConfigurationError, match=r"expected shape \(N, 3\)"):
        Recorder(MODEL).add_cloud("scan", np.zeros((4, 2)))


@numba.njit(nogil=True)
def rows_of_a_span(record, first, end, reference):
    """What `Run.show` makes of the truth at each tick, without Python."""
    for tick in range(first, end):
        record.p_pad[:] = tick
        scalars = 0.5 * tick, 0.25 * tick, 1.0 * tick, False, False
        write_row(record, tick * DT, scalars, reference, np.full(3, float(tick)), float(tick))


def test_rows_of_compiled_code_are_those_of_the_observer(monkeypatch):
    """In turn with observed steps, and past the end of the first block."""
    monkeypatch.setattr("uuv.sim.loop.recording._ROWS", 128)
    steps, span = 200, 15
    run = Run()
    recorder = Recorder(MODEL, full=False)
    assert recorder.slow_ticks == ()
    replaced, tick = 0, 0
    while tick < steps:
        run.show(recorder, PLANNER_TICKS)
        tick += PLANNER_TICKS
        assert run.reference is not None
        before = recorder.record(run.truth).rows
        recorder.ready(span)
        record = recorder.record(run.truth)
        replaced += record.rows is not before
        rows_of_a_span(record, tick, tick + span, recorder.refer(run.reference))
        tick += span
        run.truth.time = tick * DT
    assert replaced == 1
    recording = recorder.recording()
    same = Run()
    other = Recorder(MODEL, full=False)
    for _ in range(0, tick, PLANNER_TICKS + span):
        same.show(other, PLANNER_TICKS)
        same.hold(other, span)
    assert recording.digest() == other.recording().digest()
