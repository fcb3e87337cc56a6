"""A hull on a prescribed motion under the sensors of the plant, for tests of the navigation
filter.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np

from uuv.perception.navigation.strapdown_filter import Navigation, NavigationState
from uuv.sim.interfaces.messages import (
    EncoderMeasurement,
    Measurement,
    StateEstimate,
    TorqueMeasurement,
)
from uuv.sim.interfaces.spatial import GRAVITY, Array, exp_so3
from uuv.sim.sensors import proprioception

UP = np.array([0.0, 0.0, GRAVITY])


def body(time: float = 0.0) -> list[Measurement]:
    """Encoders and torque sensors of an arm of six joints."""
    return [
        EncoderMeasurement(time=time, q=np.arange(6.0), qd=np.ones(6)),
        TorqueMeasurement(time=time, tau=np.full(6, 2.0)),
    ]


class Hull:
    """Sways by 5 cm in 12 s and turns by half a radian in 30 s; its integrals are those of samples
    held over a step.
    """

    def __init__(self, step: float, sway: float = 1.0, turn: float = 1.0) -> None:
        self._step, self._turn = step, turn
        self._size = sway * np.array([0.05, 0.03, 0.02])
        self._w = 2.0 * np.pi / 12.0
        self._tick = 0
        zero = np.zeros(3)
        self.truth: Any = SimpleNamespace(
            time=0.0,
            p_WB=np.array([1.0, -2.0, -3.0]),
            v_WB_W=self._w * self._size,
            R_WB=np.eye(3),
            w_WB_B=zero,
            acceleration=zero,
        )

    def advance(self) -> None:
        truth, dt = self.truth, self._step
        self._tick += 1
        truth.time = self._tick * dt
        truth.acceleration = -self._size * self._w**2 * np.sin(self._w * truth.time)
        truth.p_WB = truth.p_WB + dt * truth.v_WB_W + 0.5 * dt**2 * truth.acceleration
        truth.v_WB_W = truth.v_WB_W + dt * truth.acceleration
        w = 2.0 * np.pi / 30.0
        truth.w_WB_B = np.array([0.0, 0.0, self._turn * 0.5 * w * np.cos(w * truth.time)])
        truth.R_WB = truth.R_WB @ exp_so3(dt * truth.w_WB_B)


@dataclass(slots=True, eq=False)
class Course:
    """What came of a run; rows are steps."""

    time: Array  # (N,) [s]
    p: Array  # (N, 3) [m] true
    v: Array  # (N, 3) [m/s] true
    p_believed: Array  # (N, 3) [m]
    v_believed: Array  # (N, 3) [m/s] in W
    R_error: Array  # (N, 3) [rad] small turn, hull axes
    estimates: list[StateEstimate]
    state: NavigationState
    # (3,) [m/s^2] true bias of the accelerometer at the end, tilt of the reference included
    bias_B: Array

    @property
    def error(self) -> Array:
        return self.p_believed - self.p


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Sensors and filter; a function of the tick and its measurements may spoil them on their way
    (`spoil`).
    """

    imu: proprioception.Imu = field(default_factory=proprioception.Imu)
    dvl: proprioception.Dvl | None = field(default_factory=proprioception.Dvl)
    vision: proprioception.VisionDrift = field(default_factory=proprioception.VisionDrift)

    def run(
        self,
        seconds: float,
        rng: np.random.Generator,
        navigation: Navigation | None = None,
        hull: Hull | None = None,
        spoil: Any = None,
    ) -> Course:
        step = self.imu.period
        navigation = navigation or Navigation(period=step)
        hull = hull or Hull(step)
        parts: Sequence[Any] = [s for s in (self.imu, self.dvl, self.vision) if s is not None]
        states = [s.init(stream) for s, stream in zip(parts, rng.spawn(len(parts)), strict=True)]
        every = [round(s.period / step) for s in parts]
        late = [round(s.delay / step) for s in parts]
        first = [s.step(state, hull.truth)[1] for s, state in zip(parts, states, strict=True)]
        state = navigation.init([*first, *body()])
        on_the_way: dict[int, list[Measurement]] = {}
        rows, estimates = [], []
        for tick in range(1, round(seconds / step)):
            hull.advance()
            truth = hull.truth
            for i, sensor in enumerate(parts):
                if tick % every[i] == 0:
                    on_the_way.setdefault(tick + late[i], []).append(
                        sensor.step(states[i], truth)[1]
                    )
            arrived = on_the_way.pop(tick, [])
            if spoil is not None:
                arrived = spoil(tick, arrived)
            state, estimate = navigation.step(state, [*body(truth.time), *arrived])
            R = estimate.X_WB[:3, :3]
            E = truth.R_WB.T @ R
            turn = 0.5 * np.array([E[2, 1] - E[1, 2], E[0, 2] - E[2, 0], E[1, 0] - E[0, 1]])
            rows.append(
                [
                    truth.time,
                    *truth.p_WB,
                    *truth.v_WB_W,
                    *estimate.X_WB[:3, 3],
                    *(R @ estimate.v_WB_B),
                    *turn,
                ]
            )
            estimates.append(estimate)
        table = np.array(rows)
        constant = states[0].bias
        truth = hull.truth
        f = truth.R_WB.T @ (truth.acceleration + UP)
        return Course(
            table[:, 0],
            table[:, 1:4],
            table[:, 4:7],
            table[:, 7:10],
            table[:, 10:13],
            table[:, 13:16],
            estimates,
            state,
            constant[:3] + f - exp_so3(-constant[3:6]) @ f,
        )
