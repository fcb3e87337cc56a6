"""The compiled steps of the tool's motion against their plain forms."""

import numpy as np
import pytest

from uuv.controllers.arm.tool_motion import bumpless, extrapolated
from uuv.sim.interfaces.spatial import exp_so3, pose


@pytest.mark.parametrize("turn", [0.0, 1e-5, 0.3, 40.0])
def test_a_pose_is_moved_on_as_by_the_exponential(turn, within):
    rng = np.random.default_rng(3)
    X_WG = pose(exp_so3(rng.standard_normal(3)), rng.standard_normal(3))
    v = rng.standard_normal(3)
    w = turn * rng.standard_normal(3)
    offset = rng.standard_normal(3)
    since, k = 0.01, 0.02
    plain = pose(exp_so3(since * w) @ X_WG[:3, :3])
    plain[:3, 3] = X_WG[:3, 3] + since * v + k * plain[:3, 2] + offset
    # measured 2.2e-16
    within("pose moved on [-, m]", extrapolated(X_WG, v, w, since, k, offset) - plain, 3e-15)


def test_an_offset_fades_critically_damped(within):
    """x(t) = (x0 + (v0 + x0/T) t) exp(-t/T), exactly, whatever the step."""
    T, dt = 0.2, 0.004
    x0 = np.array([0.02, -0.01])
    v0 = np.array([0.1, 0.3])
    q = np.array([0.4, -0.7])
    still = np.zeros(2)
    q_set = q + x0
    speed = v0
    offset = x0
    rate = v0
    for _ in range(50):
        q_set, speed, offset, rate = bumpless(q, still, q_set, offset, rate, T, 1.0, dt)
    t = 50 * dt
    # measured 5e-17
    within("offset left [rad]", offset - (x0 + (v0 + x0 / T) * t) * np.exp(-t / T), 1e-15)
    assert np.array_equal(q_set, q + offset)
    assert np.array_equal(speed, rate)


def test_no_angle_moves_faster_than_it_may_and_the_others_lag_with_it():
    """A joint that lags alone takes the tool off its way: into the surface, near a stretched
    elbow.
    """
    far = np.array([1.0, -1.0, 0.001])
    still = np.zeros(3)
    q_set, *_ = bumpless(far, still, still, still, still, 0.2, 0.01, 0.004)
    assert q_set == pytest.approx([0.01, -0.01, 1e-5])
