"""Faults do what they say, when they say it, and leave everything else as it was."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuv import models
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    ImuMeasurement,
    Target,
    ToolPath,
    TorqueMeasurement,
    WorkState,
)
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import exp_so3
from uuv.sim.plant import faults
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.proprioception import JointTorqueSensors
from uuv.sim.water.current import Current

MEAN = (0.2, -0.1, 0.0)


def truth(time: float) -> Any:
    """What the torque sensors read of the truth."""
    tau = np.array([10.0, -5.0, 2.0]) + np.sin(time)
    return SimpleNamespace(
        time=time,
        q=np.zeros(3),
        qd=np.zeros(3),
        qdd=np.zeros(3),
        tau_drive=tau,
        tau_friction=np.zeros(3),
        armature=np.zeros(3),
        joint_damping=np.zeros(3),
    )


def read(fault: faults.SensorFault | None, onset: faults.Onset, steps: int = 20) -> list[Any]:
    """Readings every 0.1 s of a torque sensor with `fault`, or of one without any."""
    sound: Sensor = JointTorqueSensors()
    sensor: Sensor = sound if fault is None else faults.FaultySensor(sound, fault, onset)
    state: Any = sensor.init(np.random.default_rng(3))
    readings = []
    for i in range(steps):
        state, reading = sensor.step(state, truth(0.1 * i))
        readings.append(reading)
    return readings


def taus(readings: list[TorqueMeasurement | None]) -> np.ndarray:
    return np.array([reading.tau for reading in readings if reading is not None])


@pytest.mark.parametrize(
    "fault",
    [
        faults.Lost(),
        faults.Frozen(("tau",), 1),
        faults.Fixed("tau", 1, float("nan")),
        faults.Offset("tau", 1, rate=2.0),
        faults.Spikes("tau", 1, 50.0, 0.5),
    ],
)
def test_outside_its_time_and_its_element_a_reading_is_what_it_would_have_been(
    fault: faults.SensorFault,
):
    sound = taus(read(None, faults.Onset(at=0.0)))
    faulty = read(fault, faults.Onset(at=0.95, duration=0.5))  # readings 10 to 14
    for i in (*range(10), *range(15, 20)):
        reading = faulty[i]
        assert reading is not None
        assert np.array_equal(reading.tau, sound[i])
    for i in range(10, 15):
        reading = faulty[i]
        if reading is None:
            assert isinstance(fault, faults.Lost)
            continue
        assert np.array_equal(reading.tau[[0, 2]], sound[i, [0, 2]])
        assert reading.time == pytest.approx(0.1 * i)


def test_each_fault_is_what_its_name_says():
    onset = faults.Onset(at=0.95)
    sound = taus(read(None, onset))
    assert read(faults.Lost(), onset)[10:] == [None] * 10
    assert np.all(taus(read(faults.Frozen(("tau",), 1), onset))[10:, 1] == sound[9, 1])
    assert np.all(taus(read(faults.Frozen(("tau",)), onset))[10:] == sound[9])
    assert np.isnan(taus(read(faults.Fixed("tau", 1, np.nan), onset))[10:, 1]).all()
    drift = taus(read(faults.Offset("tau", 1, jump=3.0, rate=2.0), onset))[10:, 1] - sound[10:, 1]
    assert np.allclose(drift, 3.0 + 2.0 * (0.1 * np.arange(10, 20) - 0.95), rtol=0.0, atol=1e-12)
    spikes = np.abs(taus(read(faults.Spikes("tau", 1, 50.0, 0.5), onset)) - sound)[10:, 1]
    assert set(np.round(spikes, 9).tolist()) == {0.0, 50.0}


def test_a_turned_attitude_turns_about_one_axis_of_the_hull(rng: np.random.Generator):
    R_WB = exp_so3(rng.standard_normal(3))
    w = rng.standard_normal(3)
    sound = ImuMeasurement(time=3.0, specific_force_B=np.ones(3), w_WB_B=w, R_WB=R_WB)
    turned = faults.Turned(1, jump=0.1, rate=0.02)(faults.Reading(sound, sound, 2.5, rng))
    assert np.allclose(R_WB.T @ turned.R_WB, exp_so3([0.0, 0.15, 0.0]), rtol=0.0, atol=1e-12)
    assert turned.w_WB_B is w


def test_an_onset_waits_for_its_event_and_does_not_begin_twice():
    onset = faults.Onset(state=WorkState.WORK, force=90.0, after=0.5, duration=1.0)

    def moment(time: float, state: WorkState, force: float) -> Any:
        return SimpleNamespace(
            truth=SimpleNamespace(time=time),
            reference=SimpleNamespace(state=state, set_force=force),
        )

    for time, state, force in (
        (1.0, "press", 95.0),
        (2.0, "work", 60.0),
        (3.0, "work", 90.0),
        (4.0, "work", 95.0),
    ):
        onset.observe(moment(time, WorkState(state), force))
    assert [onset.active(t) for t in (3.4, 3.6, 4.4, 4.6)] == [False, True, True, False]


def thrusts(*faulty: faults.ThrusterFault, command: float, seconds: float = 3.0) -> np.ndarray:
    """Thrusts [N] of a vehicle whose thrusters were asked for half of `command`, and from 1 s on
    for `command`.
    """
    model = hydrodynamics.compile(models.load("bluerov2_heavy"))
    plant = faults.FaultyPlant(Plant(model, current=Current(MEAN)), faulty)
    m = len(plant.plant.vehicle.thruster_names)
    for i in range(round(seconds / plant.timestep)):
        plant.observe()
        thrusters = np.full(m, command if i * plant.timestep >= 1.0 else 0.5 * command)
        plant.step(Command(time=0.0, joint_torque=np.zeros(0), thrusters=thrusters, scan=False))
    return np.array(plant.plant.truth.thrust)


def test_thrusters_die_stick_and_weaken():
    onset = faults.Onset(at=1.0)
    sound, half = thrusts(command=0.8), thrusts(command=0.4)
    faulty = thrusts(
        faults.ThrusterFault(0, onset),
        faults.ThrusterFault(1, onset, stuck=True),
        faults.ThrusterFault(2, onset, share=0.3),
        command=0.8,
    )
    # The hull moves otherwise, and with it the inflow: thrusts agree to some hundredths.
    assert abs(faulty[0]) < 0.05 * abs(sound[0])
    assert faulty[1] == pytest.approx(half[1], rel=0.15)
    assert faulty[2] == pytest.approx(0.3 * sound[2], rel=0.15)
    assert faulty[3] == pytest.approx(sound[3], rel=0.15)


def test_a_current_doubles_within_its_ramp_and_its_acceleration_is_its_derivative():
    dt = 0.002
    profile = faults.changing(faults.Onset(at=1.0, duration=2.0), 2.0, ramp=1.0)
    rng = np.random.default_rng(0)
    current = Current(MEAN, gust=0.03, timestep=dt, rng=rng, profile=profile)
    same = Current(MEAN, gust=0.03, timestep=dt, rng=np.random.default_rng(0))
    rows = [(current.step(), same.step()) for _ in range(2500)]
    share = np.array([changed[0][0] / plain[0][0] for changed, plain in rows])
    assert np.allclose(
        share[[0, 499, 1000, 1499, 2000, 2499]], [1.0, 1.0, 2.0, 2.0, 1.0, 1.0], rtol=0.0, atol=1e-9
    )
    velocity = np.array([changed[0] for changed, _ in rows])
    acceleration = np.array([changed[1] for changed, _ in rows])
    central = (velocity[2:] - velocity[:-2]) / (2.0 * dt)
    between = 0.5 * (acceleration[1:-1] + acceleration[2:])  # a gust's is the backward difference
    assert np.abs(central - between).max() < 1e-2  # a half step apart: 1.2e-3 measured
    assert np.abs(acceleration).max() > 0.2


def test_a_misplaced_finder_moves_pose_and_path():
    path = ToolPath(
        s=np.zeros(1),
        p=np.ones((1, 3)),
        z=np.ones((1, 3)),
        x=np.ones((1, 3)),
        on_scan=np.ones(1, dtype=bool),
    )
    found_target = Target(
        time=0.0, X_WT=np.eye(4), accepted=True, check_m=0.0, range_m=1.0, reason="", path=path
    )

    class Finder:
        def init(self) -> None: ...

        def step(self, state: None, estimate: object, measurement: object) -> tuple[None, Target]:
            return state, replace(found_target, time=float(measurement is estimate))

    finder = faults.MisplacedFinder(Finder(), (0.0, 0.0, 0.08), faults.Onset(at=0.5))
    before, target = (finder.step(finder.init(), None, measurement)[1] for measurement in (0, None))
    assert before is not None
    assert before.path is path
    assert target is not None
    assert target.path is not None
    assert np.allclose(target.path.p, [[1.0, 1.0, 1.08]], rtol=0.0, atol=1e-15)
    assert np.allclose(target.X_WT[:3, 3], [0.0, 0.0, 0.08], rtol=0.0, atol=1e-15)


def test_refusals():
    model = hydrodynamics.compile(models.load("bluerov2_heavy"))
    plant = Plant(model, current=Current(MEAN))
    with pytest.raises(ConfigurationError, match="no thruster 8"):
        faults.FaultyPlant(plant, [faults.ThrusterFault(8, faults.Onset(at=0.0))])
    with pytest.raises(ConfigurationError, match="share"):
        faults.FaultyPlant(plant, [faults.ThrusterFault(0, faults.Onset(at=0.0), share=1.5)])
    with pytest.raises(ConfigurationError, match=r"must be in \[-1, 1\], got 2"):
        faults.FaultyPlant(
            plant, [faults.ThrusterFault(0, faults.Onset(at=0.0), stuck=True, command=2.0)]
        )
    with pytest.raises(ConfigurationError, match=r"field must be one of time, tau.* got 'torque'"):
        read(faults.Fixed("torque"), faults.Onset(at=0.0))
    with pytest.raises(ConfigurationError, match="no element 3"):
        read(faults.Fixed("tau", 3), faults.Onset(at=0.0))
    with pytest.raises(ConfigurationError, match="onset at"):
        faults.Onset(at=float("nan"))
    with pytest.raises(ConfigurationError, match="ramp"):
        faults.changing(faults.Onset(at=0.0), 2.0, ramp=0.0)


def test_what_a_fault_changes_can_be_changed_by_nobody_else() -> None:
    reading = read(None, faults.Onset(0.0))[0]
    for index in (None, 1):
        changed = faults._changed(reading, "tau", index, lambda old: 2.0 * old)
        assert not changed.tau.flags.writeable
        assert changed.time == reading.time
        expected = reading.tau * ([2.0, 2.0, 2.0] if index is None else [1.0, 2.0, 1.0])
        np.testing.assert_allclose(changed.tau, expected)
    for bad in (-1, 3):
        with pytest.raises(ConfigurationError, match="no element"):
            faults._changed(reading, "tau", bad, lambda old: old)
