"""The observer of the hull against MuJoCo's water: what it can tell apart, and what it says where
it cannot.
"""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.estimation.disturbance_observer import DisturbanceObserver, observe
from uuv.controllers.hull.station_keeping import StationKeeping
from uuv.models import hydrodynamics as coefficients
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.water.current import Current

DT = 0.02  # [s]
NONE = np.zeros(3)
NAME = "bluerov2_heavy_wu2018"


class Basin:
    """A hull in MuJoCo's water, held by the hover's wrench times the thrusters' true `gain`."""

    def __init__(self, current: Current, *, water_error: float = 0.0, noise: float = 0.0) -> None:
        self.model = hydrodynamics.compile(models.load(NAME))
        hydrodynamics.install()
        self.data = mujoco.MjData(self.model)
        self.current = current
        self.hover = StationKeeping(self.model, water_error=water_error)
        self.state, self.hull = self.hover.init(), self.model.body("hull").id
        self.rng = np.random.default_rng(5)
        self.noise = noise
        self.flow = np.zeros(3)
        self.slot = coefficients.world_row(self.model)[coefficients.LAYOUT.current_acceleration :][
            :3
        ]

    def run(
        self,
        seconds: float,
        *,
        gain: float = 1.0,
        push_B: Callable[[float], Array] = lambda _: NONE,
        hidden_W: Array = NONE,
        hidden_B: Array = NONE,
    ) -> Array:
        """Errors (k, 3) [m/s] of the current; `push_B(t)` is felt and fed forward, the force
        `hidden_W` and the moment `hidden_B` are not.
        """
        errors = []
        data = self.data
        for i in range(round(seconds / DT)):
            t = DT * i
            R = data.xmat[self.hull].reshape(3, 3).copy() if data.time else np.eye(3)
            v_B = R.T @ data.qvel[:3] + self.noise * self.rng.standard_normal(3)
            measured = StateEstimate(
                time=t,
                X_WB=pose(R, data.qpos[:3]),
                v_WB_B=v_B,
                w_WB_B=data.qvel[3:6].copy(),
                a_WB_B=NONE,
                q=NONE,
                qd=NONE,
                tau=NONE,
            )
            pushed = np.concatenate([push_B(t), NONE])
            wrench = self.hover.step(self.state, measured, np.eye(4), NONE, pushed, DT)
            for _ in range(round(DT / self.model.opt.timestep)):
                self.flow, self.slot[:] = self.current.step()
                self.model.opt.wind = self.flow
                data.qfrc_applied[:] = 0.0
                force = gain * wrench + pushed
                mujoco.mj_applyFT(
                    self.model,
                    data,
                    R @ force[:3] + hidden_W,
                    R @ (force[3:] + hidden_B),
                    data.qpos[:3],
                    self.hull,
                    data.qfrc_applied,
                )
                mujoco.mj_step(self.model, data)
            errors.append(self.hover.current(self.state) - self.flow)
        return np.array(errors)


def push(t: float) -> Array:
    """20 N along x for half of the time, with soft edges."""
    return np.array([20.0, 0.0, 0.0]) * np.clip(np.sin(0.5 * t), 0.0, 0.5) * 2.0


def test_gusts_are_followed(within):
    """5 cm/s over 5 s: the error is a small part of the gust, with a velocity known to 1 mm/s."""
    gusting = Current([0.2, -0.1, 0.0], gust=0.05, timestep=0.002, rng=np.random.default_rng(3))
    basin = Basin(gusting, noise=1e-3)
    basin.run(10.0)
    errors = basin.run(60.0)
    # measured 5e-3, 9e-3
    within("RMS error [m/s], surge, sway", np.sqrt(np.mean(errors[:, :2] ** 2, axis=0)), 0.02)
    # 0.016: no mean flow, hardly any drag
    within("RMS error [m/s], heave", np.sqrt(np.mean(errors[:, 2] ** 2)), 0.03)


def test_a_wrong_gain_is_told_from_the_current_by_the_push(within):
    """Thrusters 20 % weak under a push of 20 N: the current is told in contact, and the gain comes
    to be known.
    """
    basin = Basin(Current([0.2, 0.1, 0.0]))
    basin.run(20.0, gain=0.8)
    errors = basin.run(40.0, gain=0.8, push_B=push)
    gain = basin.state.observer.gain
    within("gain", gain[0] + 0.2, 0.01)  # measured 1e-3
    within("current in contact [m/s]", errors[-1000:, 0], 0.05)  # 0.012; 4 N of drag would be 0.25


def test_what_cannot_be_told_passes_for_current_and_is_still_cancelled(within):
    """A steady force that nobody feels: the hull stays where it is, the current is wrong by what
    would explain it.
    """
    basin = Basin(Current([0.0, 0.0, 0.0]))
    basin.run(40.0, hidden_W=np.array([3.0, 0.0, 0.0]))
    within("off the place [m]", basin.data.qpos[:3], 2e-7)  # measured 1.3e-8
    assert basin.hover.current(basin.state)[0] > 0.05


def test_a_moment_nobody_feels_is_cancelled(within):
    basin = Basin(Current([0.1, 0.2, 0.0]))
    basin.run(30.0, hidden_B=np.array([0.5, -1.0, 0.7]))
    within("off the attitude [-]", basin.data.qpos[4:7], 2e-6)  # measured 1.2e-7
    # 0.14, of the water itself
    within("moment [N m]", basin.state.observer.moment_B - [0.5, -1.0, 0.7], 0.5)


@pytest.mark.parametrize("error", [-0.3, 0.3])
def test_wrong_coefficients_make_the_current_wrong_by_their_root_at_most(error, within):
    """Drag that is known 30 % wrong explains the same force by a current up to 30 % wrong; the
    place is held alike.
    """
    basin = Basin(Current([0.2, -0.1, 0.05]), water_error=error)
    errors = basin.run(60.0)
    within("off the place [m]", basin.data.qpos[:3], 2e-7)  # measured 1.3e-8
    assert np.all(np.abs(errors[-1]) < 0.35 * np.array([0.2, 0.1, 0.05]) / (1.0 + min(error, 0.0)))


def test_a_hull_that_tumbles_freely_is_pushed_by_no_moment():
    """Euler's equations with three different inertias: what turns it over is its own spin, and no
    moment is told.
    """
    turning = np.diag([20.0, 60.0, 90.0])
    inertia = np.block([[150.0 * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), turning]])
    observer = DisturbanceObserver(inertia, np.zeros(6), np.zeros(6))
    w = np.array([0.5, 0.4, 0.3])
    nothing = np.zeros(6)
    state = observer.init()
    moments = []
    spun = []
    for _ in range(500):
        observe(observer.hull, state, (np.eye(3), NONE, w), (nothing, nothing, nothing), DT)
        moments.append(state.moment_B.copy())
        spun.append(np.cross(w, turning @ w))
        for _ in range(20):
            w = w - DT / 20 * np.linalg.solve(turning, np.cross(w, turning @ w))
    assert np.abs(spun).max() > 5.0  # [N m]
    assert np.abs(moments).max() < 0.05 * np.abs(spun).max()
