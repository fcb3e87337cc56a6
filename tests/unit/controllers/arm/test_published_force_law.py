"""The published force law: a PID by hand, its limits, and its two parts together."""

import numpy as np
import pytest

from uuv.controllers.arm.published_force_law import (
    LengthForceLaw,
    PublishedForceLaw,
    TangentialForceLoop,
)
from uuv.sim.interfaces.errors import ConfigurationError

DT = 0.004  # [s]
GAINS = {"proportional": 2e-5, "integral": 3e-4, "derivative": 1e-7}
FREE = {**GAINS, "limit": 1.0, "speed": 100.0}  # limits out of reach


def by_hand(errors: np.ndarray) -> np.ndarray:
    """Displacement (N, ...) of the PID for errors (N, ...), from sums over all of them."""
    rate = np.diff(errors, axis=0, prepend=errors[:1]) / DT
    return 2e-5 * errors + 3e-4 * DT * np.cumsum(errors, axis=0) + 1e-7 * rate


def test_along_the_axis_it_is_the_pid_by_hand(within):
    felt = 60.0 + np.random.default_rng(1).normal(0.0, 5.0, 200)
    law = PublishedForceLaw(**FREE)
    state = law.init()
    k = np.array([law.step(state, 60.0, f, 1e-5, DT) for f in felt])
    within("displacement [m]", k - by_hand(60.0 - felt), 1e-15)  # measured 5e-17


def test_both_parts_displace_along_the_whole_error(within):
    """One PID for each component: along any axis the vector PID on G_f = G_F*_imp - G_F_imp."""
    rng = np.random.default_rng(2)
    z = np.array([0.6, 0.0, 0.8])
    f_tip_W = -60.0 * z + rng.normal(0.0, 5.0, (200, 3))  # of the world on the tip
    law, across = PublishedForceLaw(**FREE), TangentialForceLoop(**FREE)
    state, side = law.init(), across.init()
    moved = np.array(
        [law.step(state, 60.0, -f @ z, 0.0, DT) * z + across.step(side, f, z, DT) for f in f_tip_W]
    )
    within("displacement [m]", moved - by_hand(60.0 * z + f_tip_W), 1e-15)


def test_by_its_text_it_is_the_pid_on_the_difference_of_lengths(within):
    rng = np.random.default_rng(3)
    f_tip_W = np.array([18.0, 4.0, -57.0]) + rng.normal(0.0, 5.0, (200, 3))
    law = LengthForceLaw(**FREE)
    state = law.init()
    k = np.array([law.step_whole(state, 60.0, f, DT) for f in f_tip_W])
    within("displacement [m]", k - by_hand(60.0 - np.linalg.norm(f_tip_W, axis=1)), 1e-15)


def test_steady_friction_drives_the_tool_to_the_limit():
    across = TangentialForceLoop(limit=0.01)
    state = across.init()
    drag_W = np.array([18.0, 0.0, -60.0])
    offset = state.offset_W
    for _ in range(2000):
        offset = across.step(state, drag_W, np.array([0.0, 0.0, 1.0]), DT)
    assert offset == pytest.approx([0.01, 0.0, 0.0], abs=1e-12)
    assert np.linalg.norm(state.integral_W) < 0.011  # no windup


def test_limits_hold_and_release_goes_back_to_zero(within):
    law = PublishedForceLaw(limit=0.01, speed=0.05)
    state = law.init()
    k = [0.0]
    for _ in range(200):
        k.append(law.step(state, 500.0, 0.0, 0.0, DT))
    assert max(k) == pytest.approx(0.01)
    assert np.diff(k).max() <= 0.05 * DT + 1e-15
    for _ in range(100):
        k.append(law.release(state, DT))
    within("released [m]", k[-1], 1e-15)
    assert state.error is None


@pytest.mark.parametrize(
    "wrong", [{"integral": -1.0}, {"limit": 0.0}, {"derivative": float("nan")}]
)
def test_gains_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigurationError, match="published force law"):
        PublishedForceLaw(**wrong)
